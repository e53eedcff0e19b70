"""Running the contract for a proposal, and putting together the transaction that the client then signs.

The contract's coroutine is driven to its end in one go: its stub never suspends, so nothing else runs in between and
all reads are of one block. Source for layout and texts: Fabric ``core/endorser``, ``internal/pkg/gateway``.
"""

from __future__ import annotations

import hashlib
import logging
import secrets
from collections import OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from fabric_protos.common import common_pb2
from fabric_protos.peer import (
    chaincode_event_pb2,
    chaincode_pb2,
    proposal_pb2,
    proposal_response_pb2,
    transaction_pb2,
)

from wonderland_fabric_gateway.contract_rules import FAULT, check_result, function_name
from wonderland_fabric_gateway.embedded import rwset as rwsets
from wonderland_fabric_gateway.embedded.errors import ContractFailedError, LedgerCorruptedError
from wonderland_fabric_gateway.embedded.stub import TransactionStub
from wonderland_fabric_gateway.embedded.watchdog import DEFAULT_LIMIT_S, ContractOvertimeError, Watchdog
from wonderland_fabric_gateway.signature_policies import Signer

if TYPE_CHECKING:
    from collections.abc import Coroutine, Mapping, Sequence

    from wonderland_fabric_gateway.embedded.config_update import SigningIdentity
    from wonderland_fabric_gateway.embedded.contracts import Contract
    from wonderland_fabric_gateway.embedded.msp import Member
    from wonderland_fabric_gateway.embedded.proposals import Proposal
    from wonderland_fabric_gateway.embedded.rwset import ReadWriteSet
    from wonderland_fabric_gateway.embedded.state import StateReader

OK: Final = 200
MAX_REMEMBERED_BYTES: Final = 32 << 20
_log: Final = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Simulation:
    """What a contract did for a proposal, nothing of it committed. `event` is encoded, empty without one."""

    payload: bytes
    rwset: ReadWriteSet
    event: bytes


@dataclass(frozen=True, slots=True)
class Prepared:
    """A transaction that this process endorsed, kept so that its unchanged return needs no second look."""

    payload_sha256: bytes
    rwset: ReadWriteSet
    size: int


class Endorser:
    """Runs the channel's contracts and signs for the endorsing organisations."""

    def __init__(
        self,
        channel: str,
        reader: StateReader,
        contracts: Mapping[str, Contract],
        peers: Sequence[SigningIdentity],
        execute_limit_s: float = DEFAULT_LIMIT_S,
    ) -> None:
        self.channel = channel
        self.peers = tuple(peers)
        self.signers = tuple(Signer(peer.identity.msp_id) for peer in self.peers)
        self._reader = reader
        self._contracts = contracts
        self._watchdog = Watchdog(execute_limit_s)
        self._prepared: OrderedDict[str, Prepared] = OrderedDict()
        self._prepared_bytes = 0

    def close(self) -> None:
        """Run nothing any more."""
        self._watchdog.close()

    def has_contract(self, name: str) -> bool:
        """Whether the channel has a contract of that name."""
        return name in self._contracts

    def simulate(self, proposal: Proposal, member: Member) -> Simulation:
        """Run the contract against the committed state. Raises `ContractFailedError`, `LedgerCorruptedError`."""
        function = function_name(proposal.args)
        stub = TransactionStub(
            self._reader,
            proposal.chaincode,
            channel=self.channel,
            tx_id=proposal.tx_id,
            timestamp_ms=proposal.timestamp_ms,
            creator=member.creator,
        )
        contract = self._contracts[proposal.chaincode]
        with self._reader.snapshot():
            payload = _run(contract.invoke(stub, function, list(proposal.args[1:])), proposal, self._watchdog)
            self._reader.require_sound()  # whatever the contract made of the error
        event = b""
        if stub.event is not None:
            name, event_payload = stub.event
            event = chaincode_event_pb2.ChaincodeEvent(
                chaincode_id=proposal.chaincode, tx_id=proposal.tx_id, event_name=name, payload=event_payload
            ).SerializeToString()
        return Simulation(payload, stub.result(), event)

    def endorse(self, proposal: Proposal, member: Member, msp_ids: Sequence[str] = ()) -> common_pb2.Envelope:
        """The transaction for the client to sign, endorsed by all organisations or by those named.

        Raises `ContractFailedError`. An endorsement by fewer organisations than the policy asks for is what the
        client asked for; the commit will refuse it, as on Fabric.
        """
        simulation = self.simulate(proposal, member)
        action = proposal_pb2.ChaincodeAction(
            results=rwsets.encode(simulation.rwset, proposal.chaincode),
            events=simulation.event,
            response=proposal_response_pb2.Response(status=OK, payload=simulation.payload),
            chaincode_id=chaincode_pb2.ChaincodeID(
                name=proposal.chaincode, version=self._contracts[proposal.chaincode].version
            ),
        )
        envelope_payload, signatures = self._signed(proposal, action, msp_ids)
        if signatures == len(self.peers):
            self._remember(proposal.tx_id, envelope_payload, simulation.rwset)
        return common_pb2.Envelope(payload=envelope_payload)

    def endorse_answer(self, proposal: Proposal, answer: bytes, msp_ids: Sequence[str] = ()) -> common_pb2.Envelope:
        """The answer to a query about the ledger itself, signed by the peers: what anybody can show to others."""
        action = proposal_pb2.ChaincodeAction(
            response=proposal_response_pb2.Response(status=OK, payload=answer),
            chaincode_id=chaincode_pb2.ChaincodeID(name=proposal.chaincode),
        )
        return common_pb2.Envelope(payload=self._signed(proposal, action, msp_ids)[0])

    def _signed(
        self, proposal: Proposal, action: proposal_pb2.ChaincodeAction, msp_ids: Sequence[str]
    ) -> tuple[bytes, int]:
        """The payload of the transaction for the client to sign, and how many peers signed the response in it."""
        response = proposal_response_pb2.ProposalResponsePayload(
            proposal_hash=proposal.hash, extension=action.SerializeToString()
        ).SerializeToString()
        endorsed = transaction_pb2.ChaincodeEndorsedAction(
            proposal_response_payload=response,
            endorsements=[
                proposal_response_pb2.Endorsement(endorser=peer.creator, signature=peer.sign(response + peer.creator))
                for peer in self.peers
                if not msp_ids or peer.identity.msp_id in msp_ids
            ],
        )
        payload = transaction_pb2.ChaincodeActionPayload(chaincode_proposal_payload=proposal.payload, action=endorsed)
        transaction = transaction_pb2.Transaction(
            actions=[
                transaction_pb2.TransactionAction(header=proposal.signature_header, payload=payload.SerializeToString())
            ]
        )
        envelope_payload = common_pb2.Payload(
            header=common_pb2.Header(
                channel_header=proposal.channel_header, signature_header=proposal.signature_header
            ),
            data=transaction.SerializeToString(),
        ).SerializeToString()
        return bytes(envelope_payload), len(endorsed.endorsements)

    def take_prepared(self, tx_id: str, envelope_payload: bytes) -> ReadWriteSet | None:
        """The read-write set, if these are byte for byte what this process endorsed for that id; else None."""
        prepared = self._prepared.get(tx_id)
        if prepared is None or prepared.payload_sha256 != hashlib.sha256(envelope_payload).digest():
            return None
        del self._prepared[tx_id]
        self._prepared_bytes -= prepared.size
        return prepared.rwset

    def _remember(self, tx_id: str, envelope_payload: bytes, rwset: ReadWriteSet) -> None:
        size = rwset.size_bytes() + 512
        previous = self._prepared.pop(tx_id, None)
        if previous is not None:
            self._prepared_bytes -= previous.size
        self._prepared[tx_id] = Prepared(hashlib.sha256(envelope_payload).digest(), rwset, size)
        self._prepared_bytes += size
        while self._prepared_bytes > MAX_REMEMBERED_BYTES:
            _, oldest = self._prepared.popitem(last=False)
            self._prepared_bytes -= oldest.size


def _run(coroutine: Coroutine[Any, Any, bytes], proposal: Proposal, watchdog: Watchdog) -> bytes:
    """Drive the contract to its end. Raises `ContractFailedError`; details of a fault only go to the log."""
    try:
        with watchdog.watch(f"contract {proposal.chaincode} in transaction {proposal.tx_id}"):
            coroutine.send(None)
    except StopIteration as stop:
        result = stop.value
    except ContractOvertimeError as error:
        raise _fault(proposal, f"took longer than {watchdog.limit_s:g} s") from error
    except (ContractFailedError, LedgerCorruptedError):
        raise
    except Exception as error:  # the contract is foreign code: whatever it raises is its answer, or its fault
        status = getattr(error, "status", None)
        if isinstance(status, int) and 400 <= status < 600:
            raise ContractFailedError(status, str(error)) from error
        raise _fault(proposal, "raised an exception") from error
    else:
        coroutine.close()
        raise _fault(proposal, "waited for something other than its stub")
    try:
        return check_result(result)
    except TypeError as error:
        raise _fault(proposal, f"returned {type(result).__name__}, not bytes") from error


def _fault(proposal: Proposal, what: str) -> ContractFailedError:
    reference = secrets.token_hex(4)
    _log.error(
        "contract %s %s in transaction %s (reference %s)",
        proposal.chaincode,
        what,
        proposal.tx_id,
        reference,
        exc_info=True,
    )
    return ContractFailedError(FAULT, f"the contract failed (reference {reference}); the ledger's log says why")
