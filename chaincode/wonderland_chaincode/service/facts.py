"""From a transaction message of a peer to what the contract may know of it: channel, id, time, creator, arguments.

Source: ``peer/chaincode_shim.proto``, ``peer/proposal.proto``. The peer has checked certificate and signature; here is
seen only that the message does not contradict the proposal that it carries.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

from fabric_protos.common import common_pb2
from fabric_protos.peer import chaincode_pb2, proposal_pb2

from wonderland_chaincode.service.errors import BadTransactionError
from wonderland_fabric_gateway.contract_rules import MAX_ARGUMENT_BYTES, TOO_MUCH, function_name
from wonderland_fabric_gateway.embedded.msp import Creator
from wonderland_fabric_gateway.embedded.proposals import timestamp_ms
from wonderland_fabric_gateway.errors import ContractFailedError, IdentityError, LedgerError
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.protobuf import decode

FORBIDDEN: Final = 403
REMEMBERED_CREATORS: Final = 1024


@dataclass(frozen=True, slots=True)
class Facts:
    """One transaction as the contract sees it. `timestamp_ms` is the client's word."""

    channel: str
    tx_id: str
    timestamp_ms: int
    creator: Creator
    function: str
    args: list[bytes]


def facts_of(message: Any) -> Facts:
    """Read a TRANSACTION message (``protos.ChaincodeMessage``).

    Raises `BadTransactionError` for what a peer would never send, `ContractFailedError` for what a client can bring
    about: no function, too large an argument, a certificate that cannot be read.
    """
    call = _decode(chaincode_pb2.ChaincodeInput, message.payload, "call")
    if not message.HasField("proposal"):
        raise BadTransactionError("the transaction carries no proposal, so nobody can be said to have sent it")
    proposal = _decode(proposal_pb2.Proposal, message.proposal.proposal_bytes, "proposal")
    header = _decode(common_pb2.Header, proposal.header, "header")
    channel = _decode(common_pb2.ChannelHeader, header.channel_header, "channel header")
    sender = _decode(common_pb2.SignatureHeader, header.signature_header, "signature header")
    if (channel.channel_id, channel.tx_id) != (message.channel_id, message.txid):
        raise BadTransactionError("message and proposal name different transactions")
    try:
        time_ms = timestamp_ms(channel.timestamp)
    except LedgerError as cause:
        raise BadTransactionError(str(cause)) from cause
    args = list(call.args)
    size = sum(map(len, args))
    if size > MAX_ARGUMENT_BYTES:
        raise ContractFailedError(TOO_MUCH, f"arguments of {size} bytes; the limit is {MAX_ARGUMENT_BYTES}")
    function = function_name(args)
    try:
        creator = _creator(sender.creator)
    except IdentityError as cause:
        raise ContractFailedError(FORBIDDEN, f"the creator's certificate cannot be used: {cause}") from cause
    return Facts(channel.channel_id, channel.tx_id, time_ms, creator, function, args[1:])


@lru_cache(maxsize=REMEMBERED_CREATORS)
def _creator(serialised: bytes) -> Creator:
    """What the embedded ledger's contract would see of the same certificate."""
    identity = Identity.from_creator(serialised)
    return Creator(
        msp_id=identity.msp_id,
        role=identity.role,
        pol_id=identity.pol_id,
        common_name=identity.common_name,
        attributes=dict(identity.attributes),
        certificate_sha256=identity.certificate_sha256,
        public_key=identity.public_key_bytes,
        node_ou=identity.node_ou,
    )


def _decode(message_type: Any, data: bytes, what: str) -> Any:
    return decode(message_type, data, what, BadTransactionError)
