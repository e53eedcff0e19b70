"""Certificates that belong to people: bound with proof that their browser holds the key, used by nobody else."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from typing import Annotated, Any

from cryptography.hazmat.primitives.serialization import Encoding

from wonderland.problems import said
from wonderland.proofs import encoding
from wonderland_backend import audit
from wonderland_backend.agents.members import Members
from wonderland_backend.context import part
from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.signing import SigningKeyRow
from wonderland_backend.errors import BadRequest, Conflict, Forbidden, NotFound
from wonderland_backend.person import Person
from wonderland_backend.transactions import store
from wonderland_backend.transactions.functions import SIGNING_ROLES
from wonderland_fabric_gateway.embedded.errors import AccessDeniedError
from wonderland_fabric_gateway.embedded.msp import Member
from wonderland_fabric_gateway.errors import IdentityError
from wonderland_fabric_gateway.identity import Identity

PURPOSE = "wonderland-signing-key"


def challenge_of(person: Person) -> str:
    """What a key is to sign to show that it is there: another text for each sign-in, and known to that one alone."""
    return hashlib.sha256(f"{PURPOSE} {person.cookie_sha256}".encode()).hexdigest()


def signed_text(challenge: str, certificate_sha256: str) -> bytes:
    """The whole of what is signed."""
    return encoding.encode({"purpose": PURPOSE, "challenge": challenge, "certificate_sha256": certificate_sha256})


class SigningKeys:
    """The keys of a running backend's people."""

    def __init__(self, database: Database, members: Members, clock: Callable[[], int]) -> None:
        self._database = database
        self._members = members
        self._clock = clock

    async def bring(self, person: Person, msp_id: str, certificate: str, signature: bytes) -> SigningKeyRow:
        """Bind a certificate whose key is in the browser. Raises `Problem`."""
        member = self._member(msp_id, certificate)
        text = signed_text(challenge_of(person), member.creator.certificate_sha256)
        try:
            member.verify(text, signature)
        except AccessDeniedError as error:
            raise BadRequest(said("key_does_not_fit", why=error), ("body.signature", str(error))) from None
        return await self.bind(person, member)

    async def bind_issued(self, person: Person, msp_id: str, certificate: bytes) -> SigningKeyRow:
        """Bind what a CA has just issued for a request that the key has signed. Raises `Problem`."""
        return await self.bind(person, self._member(msp_id, certificate.decode("ascii", "replace")))

    async def bind(self, person: Person, member: Member) -> SigningKeyRow:
        """Make it one of theirs. Raises `Forbidden` for what they may not act as, `Conflict` for somebody else's."""
        creator = member.creator
        _require_theirs(person, creator.role, creator.msp_id)
        now = self._clock()
        row = {
            "certificate_sha256": creator.certificate_sha256,
            "person_id": person.person_id,
            "msp_id": creator.msp_id,
            "name": creator.common_name[:128],
            "role": creator.role,
            "not_after_ms": member.valid_to_ms,
            "certificate": _pem(member.identity),
            "bound_ms": now,
            "ended_ms": None,
        }
        async with self._database.write() as connection:
            owner = await store.owner_of_key(connection, creator.certificate_sha256)
            if owner is not None and owner != person.person_id:
                raise Conflict(said("certificate_of_other"))
            if owner is None:
                await store.add_key(connection, row)
            else:
                await store.take_key_up_again(connection, creator.certificate_sha256)
            detail = {"msp_id": creator.msp_id, "name": creator.common_name, "role": creator.role}
            subject = f"certificate/{creator.certificate_sha256}"
            await audit.record(connection, person, "bind_key", subject, detail, t_ms=now)
        return SigningKeyRow(**row)

    async def end(self, person: Person, certificate_sha256: str) -> None:
        """Nothing is signed with it here any more; whether the ledger takes it is its CA's affair."""
        now = self._clock()
        async with self._database.write() as connection:
            if not await store.end_key(connection, person.person_id, certificate_sha256, now):
                raise NotFound(said("no_such_key"))
            await audit.record(connection, person, "end_key", f"certificate/{certificate_sha256}", t_ms=now)

    async def of(self, person: Person) -> Sequence[dict[str, Any]]:
        """Somebody's keys, newest first, and whether the ledger takes them now."""
        async with self._database.read() as database:
            return [self.key_json(row) for row in await store.keys_of(database, person.person_id)]

    async def usable(self, person: Person, certificate_sha256: str) -> Identity:
        """The identity of one of their keys that the ledger takes. Raises `Forbidden`."""
        async with self._database.read() as database:
            row = await database.get(SigningKeyRow, certificate_sha256)
        if row is None or row.person_id != person.person_id or row.ended_ms is not None:
            raise Forbidden(said("key_not_yours"))
        _require_theirs(person, row.role, row.msp_id)
        problem = self._problem(row)
        if problem is not None:
            raise Forbidden(said("key_not_taken", why=problem))
        return Identity(row.msp_id, row.certificate.encode())

    def key_json(self, row: SigningKeyRow) -> dict[str, Any]:
        """The SigningKey of a row."""
        names = ("certificate_sha256", "msp_id", "name", "role", "not_after_ms", "certificate", "bound_ms")
        problem = self._problem(row)
        content = {name: getattr(row, name) for name in names} | {"usable": problem is None}
        return content | ({} if problem is None else {"problem": problem})

    def _problem(self, row: SigningKeyRow) -> str | None:
        try:
            self._members.member(row.msp_id, Identity(row.msp_id, row.certificate.encode()).creator, self._clock())
        except AccessDeniedError as error:
            return str(error)
        return None

    def _member(self, msp_id: str, certificate: str) -> Member:
        try:
            identity = Identity(msp_id, certificate.encode("ascii", "replace"))
            plain = Identity(msp_id, _pem(identity).encode())
            return self._members.member(msp_id, plain.creator, self._clock())
        except (AccessDeniedError, IdentityError, ValueError) as error:
            raise BadRequest(said("certificate_not_taken", why=error)) from None


SigningKeysDep = Annotated[SigningKeys, part(SigningKeys)]


def _require_theirs(person: Person, role: str, msp_id: str) -> None:
    """Nobody signs with more than their account allows; an administrator, who gives roles, with any."""
    if role not in SIGNING_ROLES:
        raise Forbidden(said("role_cannot_sign", role=role or "–", roles=", ".join(sorted(SIGNING_ROLES))))
    if person.has("admin"):
        return
    if role not in person.roles:
        raise Forbidden(said("role_not_yours", role=role))
    if person.msp_id and person.msp_id != msp_id:
        raise Forbidden(said("organisation_not_yours", theirs=msp_id, yours=person.msp_id))


def _pem(identity: Identity) -> str:
    """The certificate alone, in one form: what stands around it in a file is no part of who somebody is."""
    return identity.certificate.public_bytes(Encoding.PEM).decode()
