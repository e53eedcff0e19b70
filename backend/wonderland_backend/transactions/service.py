"""From a form to the ledger: proposed here, signed in the browser, endorsed, signed again, submitted, seen through.

The bytes that are signed are made here and checked there: the browser signs only what carries exactly the function
and argument that its user saw. What was submitted is submitted again, the very same bytes, until the ledger says what
became of it (decision 0008), also after a restart.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Annotated, Any, Final

import orjson
from fastapi import Depends
from starlette.requests import HTTPConnection

from wonderland.problems import said
from wonderland.proofs import encoding
from wonderland.proofs.errors import ProofError, RecordError
from wonderland.proofs.records.schema import Record
from wonderland.proofs.records.transactions import ApproveChange, RegisterUav
from wonderland.proofs.registration import TYPE, Opening
from wonderland_backend import audit
from wonderland_backend.context import part_of
from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.signing import SignedTransactionRow, SigningKeyRow
from wonderland_backend.errors import BadRequest, Conflict, Forbidden, LedgerAway, NotFound, TooManyRequests
from wonderland_backend.ledger.access import LedgerAccess, LedgerDep
from wonderland_backend.ledger.queries import transaction as transaction_of
from wonderland_backend.numbers import store as numbers
from wonderland_backend.person import Person
from wonderland_backend.transactions import problems, store
from wonderland_backend.transactions.functions import CHANGES, Change
from wonderland_backend.transactions.schemas import Propose
from wonderland_fabric_gateway.errors import LedgerError, SignatureError
from wonderland_fabric_gateway.gateway import CommitStatus, EndorseError, GatewayError, SubmitError
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import verify
from wonderland_fabric_gateway.transactions import Invocation

logger = logging.getLogger(__name__)

SIGN_WITHIN_MS: Final = 10 * 60_000
"""A proposal that nobody signs is void then: its time stamp would be of long ago."""
SWEEP_AFTER_MS: Final = SIGN_WITHIN_MS + 60_000
"""So late nobody can be signing it any more, not even in a transaction of the database that began in time."""
_TRY_AGAIN_S: Final = (5.0, 15.0, 60.0)
"""Pauses before the ledger is asked anew for an outcome that nobody could tell; the last one again and again."""


class Signing:
    """The service of a running backend. `clock` gives milliseconds since the Unix epoch."""

    def __init__(
        self,
        database: Database,
        ledger: LedgerAccess,
        clock: Callable[[], int],
        *,
        per_minute: int,
        alone: bool = False,
    ) -> None:
        """`alone`: one person plays all parts, as in a demo."""
        self._database = database
        self._ledger = ledger
        self._clock = clock
        self._per_minute = per_minute
        self._alone = alone
        self._following: dict[str, asyncio.Task[None]] = {}

    async def resume(self) -> None:
        """Go on with what a server that stopped had under way; forget the numbers of what came to nothing."""
        async with self._database.write() as connection:
            await store.sweep(connection, self._clock() - SWEEP_AFTER_MS)
        async with self._database.read() as database:
            for tx_id in await store.under_way(database):
                self._follow(tx_id, begun=True)

    async def stop(self) -> None:
        """Leave what is under way to the next start."""
        tasks = list(self._following.values())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def propose(self, person: Person, asked: Propose, identity: Identity) -> tuple[SignedTransactionRow, bytes]:
        """A proposal by that identity, and the bytes to sign. Raises `Problem`."""
        change = CHANGES.get(asked.function)
        if change is None:
            raise Forbidden(said("function_not_passed", functions=", ".join(sorted(CHANGES))))
        argument, record = _argument(change, asked.argument)
        opening = _opening(record, asked)
        await self._require_second_person(person, record)
        await self._within_rate(person)
        proposal = self._ledger.contract(identity).propose(change.function, argument)
        now = self._clock()
        row: dict[str, Any] = {
            "tx_id": proposal.tx_id,
            "person_id": person.person_id,
            "person": person.name,
            "certificate_sha256": identity.certificate_sha256,
            "function": change.function,
            "subject": change.subject_of(record)[:256],
            "argument": argument.decode(),
            "seen_block": asked.seen.block if asked.seen is not None else None,
            "seen_tx_index": asked.seen.tx_index if asked.seen is not None else None,
            "state": store.PROPOSED,
            "proposal": proposal.to_bytes(),
            "transaction": None,
            "endorsers": "",
            "block": None,
            "validation": None,
            "problem": None,
            "created_ms": now,
            "changed_ms": now,
        }
        async with self._database.write() as connection:
            await store.add(connection, row)
            if opening is not None and not await numbers.keep(
                connection, opening, person.person_id, now, tx_id=proposal.tx_id
            ):
                raise Conflict(said("salt_used"))
        return SignedTransactionRow(**row), proposal.message

    async def _require_second_person(self, person: Person, record: Record) -> None:
        """Nobody approves by another certificate what the same account has proposed.

        That certificates differ is the contract's to see; which account they belong to only we know.
        """
        if self._alone or not isinstance(record, ApproveChange):
            return
        async with self._database.read() as database:
            proposed = await store.find_transaction(database, record.change_id)
        if proposed is not None and proposed.person_id == person.person_id:
            raise Forbidden(said("own_proposal"))

    async def own_transaction(self, person: Person, tx_id: str) -> tuple[SignedTransactionRow, bytes | None]:
        """One's own transaction, and what is to be signed now. Raises `NotFound`."""
        row = await self._own(person, tx_id)
        return row, await self._to_sign(row)

    async def endorse(self, person: Person, tx_id: str, signature: bytes) -> None:
        """Have the peers run it and sign what came out; what they refuse is its end. Raises `Problem`."""
        row = await self._waiting(person, tx_id, store.PROPOSED)
        identity = await self._identity(row)
        proposal = self._ledger.proposal(identity, row.proposal)
        _require_signed(identity, proposal.message, signature)
        try:
            transaction = await proposal.signed(signature).endorse()
        except EndorseError as error:
            if error.is_unreached or error.has_no_endorsers:
                raise _away(error) from error
            await self._refuse(row, problems.of_endorsement(error))
            return
        except GatewayError as error:
            raise _away(error) from error
        found = transaction.invocation
        overtaken = _overtaken(row, found)
        if overtaken is not None:
            await self._refuse(row, overtaken)
            return
        endorsers = ",".join(sorted({each.endorser.msp_id for each in found.endorsements}))
        await self._move(
            row,
            (store.PROPOSED,),
            state=store.ENDORSED,
            transaction=transaction.to_bytes(),
            endorsers=endorsers,
        )

    async def submit(self, person: Person, tx_id: str, signature: bytes | None) -> None:
        """Hand it to the ledger and see it through, by itself from now on. Raises `Problem`."""
        row = await self._own(person, tx_id)
        if row.state in store.UNDER_WAY and signature is None:
            self._follow(tx_id, begun=True)
            return
        row = await self._waiting(person, tx_id, store.ENDORSED)
        if signature is None:
            raise BadRequest(said("sign_to_submit"), ("body.signature", said("missing")))
        identity = await self._identity(row)
        assert row.transaction is not None
        transaction = self._ledger.transaction(identity, row.transaction)
        _require_signed(identity, transaction.message, signature)
        signed = transaction.signed(signature).to_bytes()
        async with self._database.write() as connection:
            moved = await store.move(
                connection,
                tx_id,
                (store.ENDORSED,),
                state=store.SUBMITTED,
                transaction=signed,
                changed_ms=self._clock(),
            )
            if moved:
                detail = {"certificate_sha256": row.certificate_sha256, "msp_id": identity.msp_id}
                await audit.record(connection, person, row.function, row.subject, detail, tx_id, t_ms=self._clock())
        self._follow(tx_id)

    def _follow(self, tx_id: str, *, begun: bool = False) -> None:
        """`begun`: it may have been handed over before, so that a refusal now says nothing of its outcome."""
        if tx_id in self._following:
            return
        task = asyncio.create_task(self._through(tx_id, begun=begun), name=f"transaction {tx_id[:8]}")
        self._following[tx_id] = task
        task.add_done_callback(lambda _: self._following.pop(tx_id, None))

    async def _through(self, tx_id: str, *, begun: bool) -> None:
        """Submit until there is an outcome, however long the ledger is away."""
        attempt = 0
        while True:
            try:
                if await self._settle(tx_id, begun=begun or attempt > 0):
                    return
            except Exception:
                logger.exception("transaction %s could not be followed; trying again later", tx_id)
            await asyncio.sleep(_TRY_AGAIN_S[min(attempt, len(_TRY_AGAIN_S) - 1)])
            attempt += 1

    async def _settle(self, tx_id: str, *, begun: bool) -> bool:
        """One try; whether there is an outcome."""
        async with self._database.read() as database:
            row = await store.find_transaction(database, tx_id)
            mirrored = await transaction_of(database, tx_id) if begun else None
        if row is None or row.state not in store.UNDER_WAY or row.transaction is None:
            return True
        if mirrored is not None:
            where = mirrored[0]
            await self._conclude(row, CommitStatus(tx_id, where.validation_code, where.block))
            return True
        transaction = self._ledger.transaction(await self._identity(row, usable=False), row.transaction)
        try:
            await self._conclude(row, await self._ledger.settle(transaction))
        except GatewayError as error:
            if isinstance(error, SubmitError) and not error.outcome_unknown and not begun:
                problem = _json(problems.of_submission(error))
                await self._move(row, store.UNDER_WAY, state=store.REFUSED, problem=problem)
                return True
            await self._move(row, store.UNDER_WAY, state=store.UNKNOWN)
            return False
        return True

    async def _conclude(self, row: SignedTransactionRow, status: CommitStatus) -> None:
        """The ledger has said what became of it."""
        values: dict[str, Any] = {"state": store.VALID}
        if not status.is_valid:
            values = {"state": store.INVALID, "problem": _json(problems.of_outcome(status))}
        await self._move(row, store.UNDER_WAY, block=status.block_number, validation=status.code_name, **values)

    async def _own(self, person: Person, tx_id: str) -> SignedTransactionRow:
        async with self._database.read() as database:
            row = await store.find_transaction(database, tx_id)
        if row is None or row.person_id != person.person_id:
            raise NotFound(said("no_such_signing"))
        return row

    async def _waiting(self, person: Person, tx_id: str, state: str) -> SignedTransactionRow:
        row = await self._own(person, tx_id)
        if row.state in store.WAITING and row.created_ms + SIGN_WITHIN_MS <= self._clock():
            await self._move(row, store.WAITING, state=store.EXPIRED)
            raise Conflict(said("signing_expired"))
        if row.state != state:
            raise Conflict(said("transaction_in_other_state", state=row.state, needed=state))
        return row

    async def _identity(self, row: SignedTransactionRow, *, usable: bool = True) -> Identity:
        async with self._database.read() as database:
            key = await database.get(SigningKeyRow, row.certificate_sha256)
        if key is None or (usable and key.ended_ms is not None):
            raise Forbidden(said("key_gone"))
        return Identity(key.msp_id, key.certificate.encode())

    async def _to_sign(self, row: SignedTransactionRow) -> bytes | None:
        if row.state == store.PROPOSED:
            return self._ledger.proposal(await self._identity(row, usable=False), row.proposal).message
        if row.state == store.ENDORSED and row.transaction is not None:
            return self._ledger.transaction(await self._identity(row, usable=False), row.transaction).message
        return None

    async def _refuse(self, row: SignedTransactionRow, problem: dict[str, Any]) -> None:
        await self._move(row, store.WAITING, state=store.REFUSED, problem=_json(problem))

    async def _move(self, row: SignedTransactionRow, before: tuple[str, ...], **values: Any) -> None:
        async with self._database.write() as connection:
            await store.move(connection, row.tx_id, before, changed_ms=self._clock(), **values)

    async def _within_rate(self, person: Person) -> None:
        async with self._database.read() as database:
            begun = await store.count_since(database, person.person_id, self._clock() - 60_000)
        if begun >= self._per_minute:
            raise TooManyRequests(
                said("too_many_transactions", most=self._per_minute),
                headers={"Retry-After": "15"},
            )


async def signing_of(connection: HTTPConnection, _ledger: LedgerDep) -> Signing:
    """A dependency: the service of a backend that has a ledger. Raises `LedgerAway` where it has none."""
    found = part_of(connection, Signing)
    assert found is not None
    return found


SigningDep = Annotated[Signing, Depends(signing_of)]


def _argument(change: Change, value: dict[str, Any]) -> tuple[bytes, Any]:
    """The canonical bytes of what came in, as it came in, and the record that the contract will see in it."""
    try:
        record = change.argument.parse(value)
        encoded = encoding.encode(value)
    except ProofError as error:
        path, _, message = str(error).partition(": ")
        if not message:
            path, message = "argument", path
        text = said("bad_argument", function=change.function, path=path, why=message)
        raise BadRequest(text, (f"body.argument.{path}", message)) from None
    return encoded, record


def _opening(record: Record, asked: Propose) -> Opening | None:
    """What opens the commitment that is about to be signed; nothing is proposed whose number nobody would have."""
    commitment = record.registration_commitment if isinstance(record, RegisterUav) else None
    if commitment is None and asked.opening is None:
        return None
    if commitment is None or asked.opening is None or not isinstance(record, RegisterUav):
        why = said("opening_without_commitment") if commitment is None else said("commitment_without_opening")
        raise BadRequest(why, ("body.opening", why))
    given = asked.opening
    try:
        opening = Opening.parse(
            {"type": TYPE, "uav_id": record.uav_id, "registration": given.registration, "salt": given.salt}
        )
    except RecordError as error:
        raise BadRequest(said("bad_opening", why=error), (f"body.opening.{error.path}", error.message)) from None
    if opening.commitment != commitment:
        why = said("opening_does_not_fit")
        raise BadRequest(why, ("body.opening", why))
    return opening


def _require_signed(identity: Identity, message: bytes, signature: bytes) -> None:
    try:
        verify(identity.public_key, message, signature)
    except (SignatureError, LedgerError) as error:
        raise BadRequest(said("signature_does_not_fit", why=error), ("body.signature", str(error))) from None


def _overtaken(row: SignedTransactionRow, found: Invocation) -> dict[str, Any] | None:
    """What is wrong when the contract read another version of the record than the person did."""
    if row.seen_block is None or row.seen_tx_index is None:
        return None
    change = CHANGES[row.function]
    key = change.key_of(change.argument.decode(row.argument))
    read = next((read for access in found.accesses for read in access.reads if read.key == key), None)
    version = None if read is None or read.version is None else (read.version.block, read.version.transaction)
    seen = (row.seen_block, row.seen_tx_index)
    if version == seen or (version is None and seen[0] < 0):
        return None
    return problems.changed(seen, version)


def _away(error: GatewayError) -> LedgerAway:
    return LedgerAway(said("ledger_away_because", why=error.message))


def _json(problem: dict[str, Any]) -> str:
    return orjson.dumps(problem).decode()
