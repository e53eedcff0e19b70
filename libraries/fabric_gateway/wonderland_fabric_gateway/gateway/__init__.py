"""An asynchronous client of the Fabric Gateway.

    async with connection.open_channel() as channel:
        gateway = Gateway(channel, connection.identity("pad"), connection.signer("pad"))
        contract = gateway.network("wonderland").contract("pol")
        answer = await contract.evaluate("ReadPad", '{"pad_id":"pad-1"}')
        done = await contract.submit("RegisterPad", argument)     # committed and valid, or an error that says why

The same in stages, for keys that sign elsewhere: ``contract.propose(…)`` → `Proposal.endorse` → `Transaction.submit`
→ `Commit.status`; each stage has `message`, `digest`, `to_bytes` and `signed`.
"""

from wonderland_fabric_gateway.gateway.calls import Deadlines
from wonderland_fabric_gateway.gateway.client import Contract, Gateway, Network, Submitted
from wonderland_fabric_gateway.gateway.commit import Commit, CommitStatus
from wonderland_fabric_gateway.gateway.deliver import FilteredBlock, FilteredEvent, FilteredTransaction
from wonderland_fabric_gateway.gateway.errors import (
    BehindError,
    ChaincodeResponse,
    CommitError,
    CommitStatusError,
    CommitUnknownError,
    EndorseError,
    ErrorDetail,
    EvaluateError,
    GatewayError,
    MalformedError,
    StreamError,
    SubmitError,
    UnknownTransactionError,
    UnsignedError,
)
from wonderland_fabric_gateway.gateway.events import Event
from wonderland_fabric_gateway.gateway.proposal import Proposal
from wonderland_fabric_gateway.gateway.streams import Stream
from wonderland_fabric_gateway.gateway.transaction import Transaction

__all__ = [
    "BehindError",
    "ChaincodeResponse",
    "Commit",
    "CommitError",
    "CommitStatus",
    "CommitStatusError",
    "CommitUnknownError",
    "Contract",
    "Deadlines",
    "EndorseError",
    "ErrorDetail",
    "EvaluateError",
    "Event",
    "FilteredBlock",
    "FilteredEvent",
    "FilteredTransaction",
    "Gateway",
    "GatewayError",
    "MalformedError",
    "Network",
    "Proposal",
    "Stream",
    "StreamError",
    "SubmitError",
    "Submitted",
    "Transaction",
    "UnknownTransactionError",
    "UnsignedError",
]
