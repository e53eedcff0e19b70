"""The proof-of-location contract as its users see it: records in, records out, and two kinds of failure.

A `RefusedError` is final: the contract, or the ledger, said no and why. An `AwayError` says nothing about the
question: the ledger could not be asked, or its answer was lost; what was meant may be tried again after looking at
what stands on the ledger.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeVar

import grpc

from wonderland.proofs import encoding
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.audit import AnchorAuditLog, AuditHead, AuditHeadsOf
from wonderland.proofs.records.pads import Commissioning, OfferedPrekey, Pad, Prekey
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.reservations import Reservations
from wonderland.proofs.records.sessions import Evidence, Radio, Session, Testimony, TimeStamps
from wonderland.proofs.records.uavs import Uav
from wonderland.proofs.records.verdicts import Verdict
from wonderland_fabric_gateway.checkpoints import Checkpoint
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway.errors import (
    CommitError,
    CommitUnknownError,
    EndorseError,
    EvaluateError,
    GatewayError,
    UnknownTransactionError,
)

if TYPE_CHECKING:
    from wonderland.proofs.records.schema import Record
    from wonderland_fabric_gateway.checkpoints import Checkpointer
    from wonderland_fabric_gateway.gateway.client import Network

_log = logging.getLogger(__name__)

_AWAY: Final = frozenset(
    {
        grpc.StatusCode.UNAVAILABLE,
        grpc.StatusCode.DEADLINE_EXCEEDED,
        grpc.StatusCode.CANCELLED,
        grpc.StatusCode.INTERNAL,
        grpc.StatusCode.UNKNOWN,
        grpc.StatusCode.RESOURCE_EXHAUSTED,
        grpc.StatusCode.ABORTED,
    }
)
_NOT_THERE: Final = 404
_KNOWN: Final = frozenset({"SESSION_UNKNOWN", "PAD_UNKNOWN"})
_DECIDED: Final = _KNOWN | {"SESSION_REQUESTED"}
"""How a peer that is a block behind refuses what the sender has seen on the ledger already."""
LAG_S: Final = 3.0
"""How long such a peer is waited for."""
_LAG_PAUSE_S: Final = 0.05
MAX_NOTE: Final = 500
AnyRecord = TypeVar("AnyRecord", bound="Record")


class RefusedError(LedgerError):
    """The contract or the ledger refused.

    ``status`` is the contract's, as HTTP has them (0 where it was not the contract that refused); ``code`` is for
    machines, for example SESSION_EXPIRED.
    """

    def __init__(self, status: int, code: str, text: str) -> None:
        super().__init__(f"{code}: {text}")
        self.status = status
        self.code = code
        self.text = text


class AwayError(LedgerError):
    """The ledger could not be reached, or its answer was lost.

    ``tx_id`` of a transaction that may yet be committed; empty where nothing was sent for ordering.
    """

    def __init__(self, text: str, tx_id: str = "") -> None:
        super().__init__(text)
        self.tx_id = tx_id


@dataclass(frozen=True, slots=True)
class Committed:
    """A transaction that is VALID in a block."""

    tx_id: str
    block_number: int


@dataclass(frozen=True, slots=True)
class ContractEvent:
    """An event of the contract, from a committed and valid transaction."""

    name: str
    tx_id: str
    block_number: int
    record: dict[str, Any]
    checkpoint: Checkpoint


class ProofContract:
    """The contract on one channel, as one identity. Every method raises `RefusedError` and `AwayError`.

    What changes a session is for those who know it from the ledger: a peer that does not is behind, and is waited for
    (`lag_s`), in the end by `AwayError`.
    """

    def __init__(self, network: Network, chaincode: str, *, lag_s: float = LAG_S) -> None:
        self._lag_s = lag_s
        self.channel: Final = network.name
        self._network = network
        self._chaincode = chaincode
        self._contract = network.contract(chaincode)

    async def request_proof(self, argument: tx.RequestProof) -> tuple[Session, Committed]:
        """Step 1: opens a session."""
        answer, done = await self._submit("RequestProof", argument)
        return parsed_answer(Session, answer), done

    async def submit_proof(self, session_id: str, evidence: Evidence) -> tuple[Verdict, Committed]:
        """Step 7: the evidence, for a verdict."""
        argument = tx.SubmitProof(session_id=session_id, evidence=evidence)
        answer, done = await self._submit("SubmitProof", argument, _KNOWN)
        return parsed_answer(Verdict, answer), done

    async def witness_proof(
        self, session_id: str, radio: Radio, time_stamps: TimeStamps
    ) -> tuple[Testimony, Committed]:
        """Step 7 of the witness: its own time stamps of the drone's frames."""
        argument = tx.WitnessProof(session_id=session_id, radio=radio, time_stamps=time_stamps)
        answer, done = await self._submit("WitnessProof", argument)
        return parsed_answer(Testimony, answer), done

    async def read_testimony(self, session_id: str) -> Testimony | None:
        """What the witness of a session brought; None while there is nothing."""
        try:
            return parsed_answer(
                Testimony, await self._evaluate("ReadTestimony", tx.SessionById(session_id=session_id))
            )
        except RefusedError as error:
            if error.status == _NOT_THERE:
                return None
            raise

    async def complete(self, session_id: str, result: str, note: str = "") -> tuple[Session, Committed]:
        """Step 8: how the permitted interaction ended (``done`` or ``aborted``)."""
        argument = tx.CompleteInteraction(session_id=session_id, result=result, note=_note(note))
        answer, done = await self._submit("CompleteInteraction", argument, _DECIDED)
        return parsed_answer(Session, answer), done

    async def report_landing(self, argument: tx.ReportLanding) -> Committed:
        """Say that this drone came down at a pad without a permission."""
        _, done = await self._submit("ReportLanding", argument)
        return done

    async def cancel(self, session_id: str, reason: str, note: str = "") -> tuple[Session, Committed]:
        """End a session without a verdict, or one whose permission lapsed."""
        argument = tx.CancelProof(session_id=session_id, reason=reason, note=_note(note))
        answer, done = await self._submit("CancelProof", argument, _KNOWN)
        return parsed_answer(Session, answer), done

    async def give_precedence(self, session_id: str, reason: str) -> tuple[Session, Committed]:
        """Put a waiting request before all others of its pad."""
        answer, done = await self._submit(
            "GivePrecedence", tx.GivePrecedence(session_id=session_id, reason=reason), _KNOWN
        )
        return parsed_answer(Session, answer), done

    async def record_departure(self, session_id: str, note: str = "") -> tuple[Session, Committed]:
        """Say that the drone that landed in this session has left the pad."""
        answer, done = await self._submit(
            "RecordDeparture", tx.RecordDeparture(session_id=session_id, note=_note(note)), _KNOWN
        )
        return parsed_answer(Session, answer), done

    async def reserve(self, argument: tx.ReservePad) -> tuple[Reservations, Committed]:
        """Have a pad kept for a drone."""
        answer, done = await self._submit("ReservePad", argument)
        return parsed_answer(Reservations, answer), done

    async def cancel_reservation(self, argument: tx.CancelReservation) -> tuple[Reservations, Committed]:
        """Give a reservation up."""
        answer, done = await self._submit("CancelReservation", argument)
        return parsed_answer(Reservations, answer), done

    async def read_reservations(self, pad_id: str) -> Reservations:
        """For whom a pad is kept, those that are over included."""
        return parsed_answer(Reservations, await self._evaluate("ReadReservations", tx.PadById(pad_id=pad_id)))

    async def publish_prekeys(self, pad_id: str, prekeys: tuple[OfferedPrekey, ...]) -> Committed:
        """Offer one-time keys, each of which one session takes. Raises `LedgerError`."""
        _, done = await self._submit("PublishPrekeys", tx.PublishPrekeys(pad_id=pad_id, prekeys=prekeys))
        return done

    async def list_prekeys(self, pad_id: str, limit: int = 10) -> tuple[Prekey, ...]:
        """Unused prekeys of a pad."""
        answer = await self._evaluate("ListPrekeys", tx.PrekeysOf(pad_id=pad_id, limit=limit))
        listed = answer.get("prekeys", [])
        if not isinstance(listed, list):
            raise RefusedError(0, "BAD_ANSWER", "the contract's list of prekeys is no list")
        return tuple(parsed_answer(Prekey, entry) for entry in listed)

    async def register_pad(self, argument: tx.RegisterPad) -> tuple[Pad, Committed]:
        """Make a pad known; its operator's organisation owns it."""
        answer, done = await self._submit("RegisterPad", argument)
        return parsed_answer(Pad, answer), done

    async def commission_pad(self, pad_id: str, commissioning: Commissioning) -> tuple[Pad, Committed]:
        """Survey and calibration of a pad: from now on the ground of its verdicts."""
        argument = tx.CommissionPad(pad_id=pad_id, commissioning=commissioning)
        answer, done = await self._submit("CommissionPad", argument)
        return parsed_answer(Pad, answer), done

    async def read_pad(self, pad_id: str) -> Pad:
        """A pad with its commissioning."""
        return parsed_answer(Pad, await self._evaluate("ReadPad", tx.PadById(pad_id=pad_id)))

    async def read_uav(self, uav_id: str) -> Uav:
        """A drone as the ledger knows it."""
        return parsed_answer(Uav, await self._evaluate("ReadUav", tx.UavById(uav_id=uav_id)))

    async def calibrate_uav(self, argument: tx.CalibrateUav) -> tuple[Uav, Committed]:
        """What a drone's node adds to every range at a pad."""
        answer, done = await self._submit("CalibrateUav", argument, _KNOWN)
        return parsed_answer(Uav, answer), done

    async def evidence_of(self, done: Committed) -> Evidence:
        """What the pad brought with a committed SubmitProof, out of its block."""
        try:
            async with self._network.blocks(start_block=done.block_number) as blocks:
                block = await anext(aiter(blocks))
        except GatewayError as error:
            raise translated(error) from error
        for transaction in block.transactions:
            invocation = transaction.invocation
            if transaction.tx_id == done.tx_id and invocation is not None and len(invocation.args) == 2:
                return parsed_answer(tx.SubmitProof, _object(invocation.args[1])).evidence
        raise RefusedError(0, "NOT_FOUND", f"block {done.block_number} has no proof {done.tx_id[:12]}…")

    async def read_policy(self, pad_id: str, action: str) -> Policy:
        """The policy that holds for an action at a pad."""
        return parsed_answer(Policy, await self._evaluate("ReadPolicy", tx.PolicyFor(pad_id=pad_id, action=action)))

    async def read_session(self, session_id: str) -> Session:
        """A session as it stands."""
        return parsed_answer(Session, await self._evaluate("ReadSession", tx.SessionById(session_id=session_id)))

    async def read_verdict(self, session_id: str) -> Verdict | None:
        """The verdict of a session; None while there is none."""
        try:
            return parsed_answer(Verdict, await self._evaluate("ReadVerdict", tx.SessionById(session_id=session_id)))
        except RefusedError as error:
            if error.status == _NOT_THERE:
                return None
            raise

    async def events(
        self, *, checkpointer: Checkpointer | None = None, start_block: int | None = None, names: frozenset[str]
    ) -> AsyncGenerator[ContractEvent]:
        """Events with these names, for ever, through interruptions; a checkpoint says where to begin.

        Others are left out. An event that is none of this contract's is left out with a warning.
        """
        stream = self._network.chaincode_events(
            self._chaincode, start_block=start_block, checkpointer=checkpointer, reconnect=True
        )
        try:
            async for event in stream:
                if event.name not in names:
                    continue
                record = _record_of(event.name, event.tx_id, event.payload)
                if record is not None:
                    yield ContractEvent(event.name, event.tx_id, event.block_number, record, event.checkpoint)
        except GatewayError as error:
            raise translated(error) from error
        finally:
            stream.close()

    async def history(
        self, names: frozenset[str], on_block: Callable[[int, int], None] | None = None
    ) -> AsyncGenerator[ContractEvent]:
        """Events with these names from the first block to the newest of now, from valid transactions.

        ``on_block``: told how many blocks were read, of how many.
        """
        height = await self.height()
        stream = self._network.blocks(start_block=0)
        try:
            async for block in stream:
                for at in block.transactions:
                    event = at.event
                    if at.is_valid and event is not None and event.chaincode == self._chaincode and event.name in names:
                        record = _record_of(event.name, at.tx_id, event.payload)
                        if record is not None:
                            after = Checkpoint.after_block(block.number)
                            yield ContractEvent(event.name, at.tx_id, block.number, record, after)
                if on_block is not None:
                    on_block(block.number + 1, height)
                if block.number + 1 >= height:
                    return
        except GatewayError as error:
            raise translated(error) from error
        finally:
            stream.close()

    async def change(self, argument: Record) -> tuple[dict[str, Any], Committed]:
        """Submit the transaction whose argument this is: what it answers."""
        name = next(each.name for each in tx.TRANSACTIONS.values() if each.argument is type(argument) and each.event)
        return await self._submit(name, argument)

    async def height(self) -> int:
        """How many blocks the channel has."""
        try:
            return await self._network.height()
        except GatewayError as error:
            raise translated(error) from error

    async def anchor_audit_log(self, argument: AnchorAuditLog) -> tuple[AuditHead, Committed]:
        """Write down where an audit log stands."""
        answer, done = await self._submit("AnchorAuditLog", argument)
        return parsed_answer(AuditHead, answer), done

    async def audit_heads(self, argument: AuditHeadsOf) -> tuple[AuditHead, ...]:
        """Heads of an audit log, oldest first."""
        listed = (await self._evaluate("ListAuditHeads", argument)).get("heads")
        if not isinstance(listed, list):
            raise RefusedError(0, "BAD_ANSWER", "the contract's list of audit heads is no list")
        return tuple(parsed_answer(AuditHead, each) for each in listed)

    async def _submit(
        self, function: str, argument: Record, behind: frozenset[str] = frozenset()
    ) -> tuple[dict[str, Any], Committed]:
        """Submit. `behind`: codes of refusals that only a peer which is behind can mean."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + self._lag_s
        while True:
            try:
                done = await self._contract.submit_with_retry(function, argument.encode())
            except GatewayError as error:
                refusal = translated(error)
                if not isinstance(refusal, RefusedError) or refusal.code not in behind:
                    raise refusal from error
                await self._contract.leave_if_behind()
                if loop.time() >= deadline_s:
                    raise AwayError(f"a peer that must endorse is behind: {refusal}") from error
            else:
                return _object(done.payload), Committed(done.tx_id, done.block_number)
            await asyncio.sleep(_LAG_PAUSE_S)

    async def _evaluate(
        self, function: str, argument: Record, *, max_bytes: int = encoding.MAX_BYTES
    ) -> dict[str, Any]:
        try:
            return _object(await self._contract.evaluate(function, argument.encode()), max_bytes)
        except GatewayError as error:
            refusal = translated(error)
            if isinstance(refusal, RefusedError) and refusal.status == _NOT_THERE:
                await self._contract.leave_if_behind()  # the caller may know that it is there, and ask again
            raise refusal from error


def _record_of(name: str, tx_id: str, payload: bytes) -> dict[str, Any] | None:
    """What an event carries; None, with a warning, where it is none of this contract's."""
    try:
        decoded = encoding.decode(payload)
    except ProofError as error:
        _log.warning("event %s of transaction %s cannot be read: %s", name, tx_id, error)
        return None
    record = decoded.get("record", decoded) if isinstance(decoded, dict) else None
    return record if isinstance(record, dict) else None


def _note(text: str) -> str | None:
    """A note for people as the records allow it: one line, bounded; None for an empty one."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())[:MAX_NOTE] or None


def translated(error: GatewayError) -> LedgerError:
    """`RefusedError` or `AwayError` for what the gateway client raised."""
    response = error.chaincode_response
    if response is not None:
        code, separator, text = response.message.partition(": ")
        return RefusedError(response.status, code if separator else "REFUSED", text if separator else response.message)
    if isinstance(error, CommitError):
        return RefusedError(0, error.code_name, str(error))
    if isinstance(error, UnknownTransactionError) and error.status_code in {None, grpc.StatusCode.NOT_FOUND}:
        return RefusedError(0, grpc.StatusCode.NOT_FOUND.name, error.message)
    if isinstance(error, CommitUnknownError) or error.status_code is None or error.status_code in _AWAY:
        sent = not isinstance(error, EndorseError | EvaluateError)
        return AwayError(str(error), error.tx_id if sent else "")
    return RefusedError(0, error.status_code.name, str(error))


def _object(payload: bytes, max_bytes: int = encoding.MAX_BYTES) -> dict[str, Any]:
    try:
        value = encoding.decode(payload, max_bytes=max_bytes)
    except ProofError as error:
        raise RefusedError(0, "BAD_ANSWER", f"the contract's answer cannot be read: {error}") from error
    if not isinstance(value, dict):
        raise RefusedError(0, "BAD_ANSWER", "the contract's answer is no object")
    return value


def parsed_answer(kind: type[AnyRecord], value: Any) -> AnyRecord:
    """A record of the contract's answer. Raises `RefusedError` for what is none."""
    try:
        return kind.parse(value)
    except ProofError as error:
        raise RefusedError(0, "BAD_ANSWER", f"the contract's {kind.__name__} cannot be read: {error}") from error
