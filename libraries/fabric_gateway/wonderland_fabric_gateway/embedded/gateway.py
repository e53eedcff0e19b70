"""The gateway.Gateway service: Evaluate, Endorse, Submit, CommitStatus (ChaincodeEvents is in `deliver`).

Codes, texts and details are those of Fabric's gateway (``internal/pkg/gateway``), so that clients need not tell the
two apart: what a contract refuses is ABORTED with details from Endorse and UNKNOWN from Evaluate.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import grpc
from fabric_protos.gateway import gateway_pb2
from fabric_protos.peer import proposal_response_pb2

from wonderland_fabric_gateway.embedded.endorser import OK
from wonderland_fabric_gateway.embedded.errors import (
    AccessDeniedError,
    ContractFailedError,
    MalformedRequestError,
    ProposalRefusedError,
)
from wonderland_fabric_gateway.embedded.proposals import Proposal, check_proposal, parse_proposal
from wonderland_fabric_gateway.embedded.rpc import RpcError
from wonderland_fabric_gateway.embedded.system import LEDGER
from wonderland_fabric_gateway.embedded.system import NAMES as SYSTEM_NAMES
from wonderland_fabric_gateway.embedded.transactions import accept
from wonderland_fabric_gateway.protobuf import decode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wonderland_fabric_gateway.embedded.chain import Chain
    from wonderland_fabric_gateway.embedded.endorser import Endorser
    from wonderland_fabric_gateway.embedded.msp import Member
    from wonderland_fabric_gateway.embedded.system import SystemQueries

_ENDORSE_FAILED: Final = "failed to endorse transaction, see attached details for more info"


class GatewayService:
    """The four calls, each from request bytes to response bytes. `address` names this ledger in error details."""

    def __init__(self, chain: Chain, endorser: Endorser, system: SystemQueries, address: str) -> None:
        self._chain = chain
        self._endorser = endorser
        self._system = system
        self._address = address
        self._msp_id = endorser.peers[0].identity.msp_id

    async def evaluate(self, data: bytes) -> bytes:
        """EvaluateRequest → EvaluateResponse."""
        request = _decode(gateway_pb2.EvaluateRequest, data, "evaluate request")
        proposal = parse_proposal(request.proposed_transaction)
        self._require_known(proposal, request.target_organizations)
        try:
            member = self._check(proposal)
            if proposal.chaincode in SYSTEM_NAMES:
                payload = await self._system.invoke(proposal.chaincode, proposal.args, member)
            else:
                payload = self._endorser.simulate(proposal, member).payload
        except ContractFailedError as error:
            raise self._evaluate_failed(grpc.StatusCode.UNKNOWN, _chaincode_response(error)) from error
        except (AccessDeniedError, ProposalRefusedError) as error:
            raise self._evaluate_failed(grpc.StatusCode.FAILED_PRECONDITION, _validating(error)) from error
        result = proposal_response_pb2.Response(status=OK, payload=payload)
        return bytes(gateway_pb2.EvaluateResponse(result=result).SerializeToString())

    async def endorse(self, data: bytes) -> bytes:
        """EndorseRequest → EndorseResponse with the transaction to sign."""
        self._chain.require_writable()
        request = _decode(gateway_pb2.EndorseRequest, data, "endorse request")
        proposal = parse_proposal(request.proposed_transaction)
        organisations = tuple(request.endorsing_organizations)
        self._require_known(proposal, organisations, endorsing=True)
        try:
            member = self._check(proposal)
            if proposal.chaincode in SYSTEM_NAMES:
                answer = await self._system.invoke(proposal.chaincode, proposal.args, member)
                envelope = self._endorser.endorse_answer(proposal, answer, organisations)
            else:
                envelope = self._endorser.endorse(proposal, member, organisations)
        except ContractFailedError as error:
            raise self._endorse_failed(_chaincode_response(error)) from error
        except (AccessDeniedError, ProposalRefusedError) as error:
            raise self._endorse_failed(_validating(error)) from error
        return bytes(gateway_pb2.EndorseResponse(prepared_transaction=envelope).SerializeToString())

    async def submit(self, data: bytes) -> bytes:
        """SubmitRequest → SubmitResponse, as soon as the transaction is in line for a block."""
        request = _decode(gateway_pb2.SubmitRequest, data, "submit request")
        if not request.HasField("prepared_transaction"):
            raise MalformedRequestError("a prepared transaction is required")
        if not request.prepared_transaction.signature:
            raise MalformedRequestError("prepared transaction must be signed")
        self._chain.require_writable()
        try:
            candidate = accept(
                request.prepared_transaction, self._endorser, self._chain.membership, self._chain.settings.clock()
            )
        except AccessDeniedError as error:
            raise _orderer_refused("FORBIDDEN", error) from error
        except (MalformedRequestError, ProposalRefusedError) as error:
            raise _orderer_refused("BAD_REQUEST", error) from error
        self._chain.submit(candidate)
        return bytes(gateway_pb2.SubmitResponse().SerializeToString())

    async def commit_status(self, data: bytes) -> bytes:
        """SignedCommitStatusRequest → CommitStatusResponse, once the transaction is durably committed."""
        signed = _decode(gateway_pb2.SignedCommitStatusRequest, data, "commit status request")
        if not signed.request:
            raise MalformedRequestError("a commit status request is required")
        request = _decode(gateway_pb2.CommitStatusRequest, signed.request, "commit status request")
        if not request.identity:
            raise MalformedRequestError("no identity provided")
        if not request.transaction_id:
            raise MalformedRequestError("transaction ID should not be empty")
        self.require_channel(request.channel_id)
        membership = self._chain.membership
        member = membership.application_member(request.identity, self._chain.settings.clock())
        member.verify(signed.request, signed.signature)
        location = await self._chain.transaction(request.transaction_id)
        return bytes(
            gateway_pb2.CommitStatusResponse(result=location.code, block_number=location.block).SerializeToString()
        )

    def require_channel(self, channel: str) -> None:
        """Raise `ProposalRefusedError` unless it is this ledger's channel."""
        mine = self._chain.settings.channel
        if channel != mine:
            raise ProposalRefusedError(f"channel {channel[:80]!r} not found; this ledger has {mine!r}")

    def _check(self, proposal: Proposal) -> Member:
        chain = self._chain
        member = check_proposal(proposal, chain.settings.channel, chain.membership, chain.settings.clock())
        if chain.has_transaction(proposal.tx_id):
            raise ProposalRefusedError(
                f"duplicate transaction found [{proposal.tx_id}]. Make a new proposal, with a new nonce"
            )
        return member

    def _require_known(self, proposal: Proposal, organisations: Sequence[str], *, endorsing: bool = False) -> None:
        self.require_channel(proposal.channel)
        name = proposal.chaincode
        # As on Fabric, what a system contract answers is signed only where organisations are named.
        answers = name in SYSTEM_NAMES and (not endorsing or (name != LEDGER and organisations))
        if not self._endorser.has_contract(name) and not answers:
            raise RpcError(
                grpc.StatusCode.FAILED_PRECONDITION,
                f"no peers available to {'endorse' if endorsing else 'evaluate'} chaincode {name[:80]} in channel "
                f"{proposal.channel}: this ledger {'only evaluates' if name in SYSTEM_NAMES else 'does not run'} it",
            )
        known = {peer.identity.msp_id for peer in self._endorser.peers}
        unknown = [each[:80] for each in organisations if each not in known]
        if unknown and (endorsing or len(unknown) == len(organisations)):
            raise RpcError(
                grpc.StatusCode.UNAVAILABLE if endorsing else grpc.StatusCode.FAILED_PRECONDITION,
                f"failed to find any endorsing peers for org(s): {', '.join(unknown)} "
                f"(this ledger endorses for {', '.join(sorted(known))})",
            )

    def _evaluate_failed(self, code: grpc.StatusCode, text: str) -> RpcError:
        return RpcError(code, f"evaluate call to endorser returned error: {text}", [self._detail(text)])

    def _endorse_failed(self, text: str) -> RpcError:
        return RpcError(grpc.StatusCode.ABORTED, _ENDORSE_FAILED, [self._detail(text)])

    def _detail(self, text: str) -> tuple[str, str, str]:
        return self._address, self._msp_id, text


def _chaincode_response(error: ContractFailedError) -> str:
    return f"chaincode response {error.status}, {error}"


def _validating(error: AccessDeniedError | ProposalRefusedError) -> str:
    return f"error validating proposal: {error}"


def _orderer_refused(status: str, error: Exception) -> RpcError:
    return RpcError(
        grpc.StatusCode.ABORTED, f"received unsuccessful response from orderer: status={status}, info={error}"
    )


def _decode(message_type: Any, data: bytes, what: str) -> Any:
    return decode(message_type, data, what, MalformedRequestError)
