"""Clients in the database: added by an administrator, revoked for good, found at each token."""

from __future__ import annotations

import hashlib
import hmac
from base64 import urlsafe_b64encode
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

import orjson
from cryptography import x509
from sqlalchemy import delete, insert, or_, select, update
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland.problems import SaidError, said
from wonderland_backend import audit
from wonderland_backend.audit.store import Actor
from wonderland_backend.clients.certificates import ShownCertificate, names_of, read_pem, sha256_of
from wonderland_backend.clients.scopes import NAMING, SCOPES
from wonderland_backend.context import part
from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.clients import AssertionRow, ClientRow, IdempotencyRow
from wonderland_backend.db.tables.people import PersonRow
from wonderland_backend.errors import NotFound
from wonderland_backend.http.transfer import TransferError
from wonderland_backend.person import roles_of
from wonderland_backend.tokens import read_keys

SECRET_BYTES: Final = 32
CLIENT: Final = "wl-"
"""How the identifiers of clients begin; those of people are hexadecimal."""
MAX_KEYS: Final = 8
SHA256: Final = "sha256"
HOUR_MS: Final = 3_600_000
ACTIVE: Final = "active"
"""The state of a person who may sign in."""
_PRIVATE: Final = frozenset({"d", "p", "q", "k"})
Role = Literal["viewer", "inspector", "pad_operator", "fleet_operator"]
ROLES: Final[tuple[Role, ...]] = ("viewer", "inspector", "pad_operator", "fleet_operator")
OWN_ONLY: Final = frozenset({"pad_operator", "fleet_operator"})
"""Roles that see the things of one organisation."""


class ClientError(SaidError):
    """A client cannot be registered as asked."""


@dataclass(frozen=True)
class ByCertificate:
    """The certificate of a client: any of our client CAs with one of its names, or this very one (RFC 8705, 2)."""

    kind: Literal["subject_dn", "san_dns", "san_uri", "sha256"]
    value: str

    @classmethod
    def named(cls, kind: Literal["subject_dn", "san_dns", "san_uri"], name: str) -> ByCertificate:
        """By a name. Raises `ClientError`."""
        if not 0 < len(name) <= 500 or not name.isprintable():
            raise ClientError(said("client_certificate_name", kind=kind))
        if kind == "subject_dn":
            try:
                return cls(kind, x509.Name.from_rfc4514_string(name).rfc4514_string())
            except ValueError:
                raise ClientError(said("client_subject_dn")) from None
        return cls(kind, name.lower() if kind == "san_dns" else name)

    @classmethod
    def pinned(cls, pem: str) -> ByCertificate:
        """By the certificate itself (PEM). Raises `ClientError`."""
        try:
            return cls(SHA256, sha256_of(read_pem(pem)).hex())
        except ValueError as cause:
            raise ClientError(said("client_certificate_pem", why=cause)) from None

    def stored(self) -> dict[str, str]:
        """As it is kept, and shown."""
        return {self.kind: self.value}


def is_certificate_of(row: ClientRow, shown: ShownCertificate) -> bool:
    """Whether this is the client's certificate."""
    if row.tls is None:
        return False
    ((kind, value),) = orjson.loads(row.tls).items()
    if kind == SHA256:
        return hmac.compare_digest(value, shown.sha256.hex())
    return shown.trusted and value in names_of(shown.certificate).get(kind, set())


@dataclass(frozen=True)
class NewClient:
    """What an administrator decides about a client."""

    name: str
    scopes: tuple[str, ...]
    role: Role = "viewer"
    msp_id: str = ""
    jwks: dict[str, Any] | None = None
    """Public keys of a client that signs assertions; without them it gets a secret."""
    tls: ByCertificate | None = None
    """The certificate by which it authenticates in place of both."""

    def check(self) -> None:
        """Raises `ClientError` for what cannot be registered so."""
        if not 0 < len(self.name) <= 120:
            raise ClientError(said("client_name"))
        unknown = [scope for scope in self.scopes if scope not in SCOPES]
        if unknown or not self.scopes:
            raise ClientError(said("client_scopes", scopes=" ".join(unknown) or "–", known=" ".join(SCOPES)))
        if self.role not in ROLES:
            raise ClientError(said("client_role", role=self.role, known=", ".join(ROLES)))
        if (self.role in OWN_ONLY) != bool(self.msp_id):
            raise ClientError(said("client_organisation"))
        if self.jwks is not None and self.tls is not None:
            raise ClientError(said("client_keys_or_certificate"))
        if self.jwks is not None:
            self._check_keys(self.jwks)

    @staticmethod
    def _check_keys(jwks: dict[str, Any]) -> None:
        try:
            given, good = len(jwks.get("keys", ())), read_keys(jwks).keys
        except (TransferError, TypeError) as cause:
            raise ClientError(said("client_keys_unreadable", why=cause)) from None
        if not 0 < len(good) <= MAX_KEYS or len(good) != given:
            raise ClientError(said("client_keys", most=MAX_KEYS))
        if any(not _PRIVATE.isdisjoint(each) for each in jwks["keys"]):
            raise ClientError(said("client_private_key"))


class Clients:
    """The registered clients. Only hashes of secrets are kept."""

    def __init__(self, database: Database, clock: Callable[[], int], randomness: Callable[[int], bytes]) -> None:
        self._database = database
        self._clock = clock
        self._randomness = randomness

    async def add(
        self, connection: AsyncConnection, wanted: NewClient, by: Actor | str
    ) -> tuple[ClientRow, str | None]:
        """Register; returns the client, and its secret where it has one: this once. Raises `ClientError`."""
        wanted.check()
        secret = None
        if wanted.jwks is None and wanted.tls is None:
            secret = urlsafe_b64encode(self._randomness(SECRET_BYTES)).rstrip(b"=").decode()
        row = {
            "client_id": CLIENT + self._randomness(12).hex(),
            "name": wanted.name,
            "scopes": " ".join(dict.fromkeys(wanted.scopes)),
            "role": wanted.role,
            "msp_id": wanted.msp_id,
            "secret_sha256": sha256(secret) if secret is not None else None,
            "jwks": orjson.dumps(wanted.jwks).decode() if wanted.jwks is not None else None,
            "tls": orjson.dumps(wanted.tls.stored()).decode() if wanted.tls is not None else None,
            "created_ms": self._clock(),
            "created_by": by if isinstance(by, str) else by.name,
            "owner_id": "" if isinstance(by, str) else by.person_id,
            "revoked_ms": None,
            "last_token_ms": None,
        }
        await connection.execute(insert(ClientRow), [row])
        detail = {"name": wanted.name, "scopes": row["scopes"], "role": wanted.role}
        await audit.record(connection, by, "add_client", f"client/{row['client_id']}", detail, t_ms=self._clock())
        return ClientRow(**row), secret

    async def revoke(self, connection: AsyncConnection, client_id: str, by: Actor | str) -> None:
        """From now on it gets no token, and those it has are worth nothing. Raises `NotFound`."""
        known = await connection.execute(select(ClientRow.client_id).where(ClientRow.client_id == client_id))
        if known.first() is None:
            raise NotFound(said("no_such_client", client_id=client_id))
        done = await connection.execute(
            update(ClientRow)
            .where(ClientRow.client_id == client_id, ClientRow.revoked_ms.is_(None))
            .values(revoked_ms=self._clock())
        )
        if done.rowcount:
            await audit.record(connection, by, "revoke_client", f"client/{client_id}", t_ms=self._clock())

    async def find_client(self, client_id: str) -> ClientRow | None:
        """A client, revoked or not, with what is left of its rights today."""
        async with self._database.read() as session:
            return await find_limited(session, client_id, self._clock())

    async def used(self, client: ClientRow) -> None:
        """A token was issued to it, as `client` was before. In the audit log the first one of an hour is written."""
        now_ms = self._clock()
        changed = update(ClientRow).where(ClientRow.client_id == client.client_id).values(last_token_ms=now_ms)
        async with self._database.write() as connection:
            await connection.execute(changed)
            if client.last_token_ms is None or now_ms - client.last_token_ms >= HOUR_MS:
                subject = f"client/{client.client_id}"
                await audit.record(connection, client.name, "token_issued", subject, t_ms=now_ms)

    async def spend(self, client_id: str, jti: str, expires_ms: int) -> bool:
        """Take an assertion in; False where it was spent before."""
        row = {"jti_sha256": sha256(f"{client_id}\0{jti}"), "expires_ms": expires_ms}
        async with self._database.write() as connection:
            dialect: Any = sqlite if self._database.is_sqlite else postgresql
            statement = dialect.insert(AssertionRow).on_conflict_do_nothing(index_elements=["jti_sha256"])
            new = (await connection.execute(statement.returning(AssertionRow.jti_sha256), row)).first() is not None
            await connection.execute(delete(AssertionRow).where(AssertionRow.expires_ms < self._clock() - 60_000))
        return new


async def find_limited(session: AsyncSession, client_id: str, now_ms: int = 0) -> ClientRow | None:
    """A client as far as the person who registered it still goes: with less, or as if it were revoked.

    Asked at each request, so that a machine loses with its person, and at once.
    """
    client = await session.get(ClientRow, client_id)
    if client is None or not client.owner_id:
        return client
    session.expunge(client)  # what is set here is nobody's to write
    columns = (PersonRow.state, PersonRow.roles, PersonRow.msp_id)
    owner = (await session.execute(select(*columns).where(PersonRow.person_id == client.owner_id))).first()
    held = roles_of(owner.roles) if owner is not None and owner.state == ACTIVE else ()
    left = role_within(client.role, client.msp_id, held, owner.msp_id if owner is not None else "")
    if left is None:
        client.revoked_ms = client.revoked_ms if client.revoked_ms is not None else now_ms
    else:
        client.role = left
    if held and not {"admin", "inspector"}.intersection(held):
        client.scopes = " ".join(each for each in client.scopes.split() if each not in NAMING)
    return client


def role_within(role: str, msp_id: str, held: Sequence[str], held_msp_id: str) -> str | None:
    """What a machine may be whose person has these roles now: what it is, a viewer, or nothing."""
    if "admin" in held or (role in held and (role not in OWN_ONLY or msp_id == held_msp_id)):
        return role
    if role in OWN_ONLY:
        return role if "inspector" in held else None
    return "viewer" if not {"inspector", "viewer"}.isdisjoint(held) else None


ClientsDep = Annotated[Clients, part(Clients)]


async def listing(database: AsyncSession, *, after: str | None = None, limit: int) -> Sequence[ClientRow]:
    """Clients by identifier, those after `after`, at most `limit`; revoked ones too."""
    query = select(ClientRow).order_by(ClientRow.client_id).limit(limit)
    if after is not None:
        query = query.where(ClientRow.client_id > after)
    return (await database.scalars(query)).all()


def is_secret_of(row: ClientRow, secret: str) -> bool:
    """Whether this is the client's secret, compared in constant time."""
    return row.secret_sha256 is not None and hmac.compare_digest(row.secret_sha256, sha256(secret))


def client_json(row: ClientRow) -> dict[str, Any]:
    """The client as the interface shows it: never its secret."""
    content: dict[str, Any] = {
        "client_id": row.client_id,
        "name": row.name,
        "scopes": row.scopes.split(),
        "role": row.role,
        "method": _method(row),
        "created_ms": row.created_ms,
        "created_by": row.created_by,
    }
    for name in ("msp_id", "revoked_ms", "last_token_ms"):
        value = getattr(row, name)
        if value not in {None, ""}:
            content[name] = value
    if row.tls is not None:
        content["certificate"] = orjson.loads(row.tls)
    return content


def _method(row: ClientRow) -> str:
    if row.tls is not None:
        return "self_signed_tls_client_auth" if SHA256 in orjson.loads(row.tls) else "tls_client_auth"
    return "private_key_jwt" if row.jwks is not None else "client_secret_basic"


def sha256(text: str) -> str:
    """Hexadecimal SHA-256 of a text."""
    return hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()


async def begin_request(connection: AsyncConnection, row: dict[str, Any], *, kept_ms: int, lease_ms: int) -> None:
    """Put a request's key down; those of long ago go, and those whose server has stopped.

    Raises `IntegrityError` for a key that was used before.
    """
    now_ms = row["created_ms"]
    over = or_(
        IdempotencyRow.created_ms < now_ms - kept_ms,
        IdempotencyRow.status.is_(None) & (IdempotencyRow.created_ms < now_ms - lease_ms),
    )
    await connection.execute(delete(IdempotencyRow).where(over))
    await connection.execute(insert(IdempotencyRow), [row])


async def forget_request(connection: AsyncConnection, which: dict[str, Any]) -> None:
    """It failed, and may be sent again."""
    await connection.execute(delete(IdempotencyRow).filter_by(**which))


async def keep_answer(connection: AsyncConnection, which: dict[str, Any], answer: dict[str, Any]) -> None:
    """What it was answered."""
    await connection.execute(update(IdempotencyRow).filter_by(**which).values(**answer))
