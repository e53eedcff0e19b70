"""Running the contract for one transaction message, and the message that answers it.

The contract's coroutine may wait for its stub and for nothing else, as on the embedded ledger, where a foreign wait is
a fault, too: what a clock or a network could change would come out differently on each endorser. That also keeps one
question of a transaction in flight, since Fabric drops a second one silently.
"""

from __future__ import annotations

import logging
import secrets
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from fabric_protos.peer import chaincode_event_pb2, proposal_response_pb2
from fabric_protos.peer import chaincode_shim_pb2 as shim

from wonderland_chaincode.service.errors import (
    BadTransactionError,
    ContractFaultError,
    PeerRefusedError,
    ServiceError,
    StreamProtocolError,
    UnavailableError,
)
from wonderland_chaincode.service.facts import facts_of
from wonderland_chaincode.service.stub import PeerStub
from wonderland_fabric_gateway.contract_rules import FAULT, check_result
from wonderland_fabric_gateway.errors import ContractFailedError

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Generator

    from wonderland_chaincode.service.facts import Facts
    from wonderland_chaincode.service.stub import Ask, Batching
    from wonderland_fabric_gateway.embedded.contracts import Contract

OK: Final = 200
_log: Final = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a transaction: the message for the peer, and for the books a function and a word."""

    message: Any
    function: str
    word: str
    """ok · refused (by the contract) · fault (of the contract) · unavailable (ours or the peer's) · bad (message)."""


class Waits:
    """Awaits a contract's coroutine, and lets it wait for one thing only: what ``pending`` gives at that moment."""

    __slots__ = ("_coroutine", "_pending")

    def __init__(self, coroutine: Coroutine[Any, Any, bytes], pending: Callable[[], object]) -> None:
        self._coroutine = coroutine
        self._pending = pending

    def __await__(self) -> Generator[Any, Any, bytes]:
        thrown: BaseException | None = None
        coroutine = self._coroutine
        try:
            while True:
                try:
                    waited = coroutine.send(None) if thrown is None else coroutine.throw(thrown)
                except StopIteration as stop:
                    return stop.value  # type: ignore[no-any-return]
                if waited is None or waited is not self._pending():
                    raise ContractFaultError("the contract waited for something other than its stub")
                thrown = None
                try:
                    yield waited
                except GeneratorExit:
                    raise
                except BaseException as error:  # noqa: BLE001 - handed to the contract, cancellation among them
                    thrown = error
        finally:
            coroutine.close()


async def invoke(
    message: Any,
    contract: Contract,
    ask: Ask,
    pending: Callable[[], object],
    batching: Batching,
    check: Callable[[Facts], None],
) -> Outcome:
    """The answer to one TRANSACTION message. Never raises but when it is cancelled.

    A refusal of the contract is COMPLETED with its status: every endorser would say the same. What only this service
    or this peer cannot do is ERROR: the Gateway then asks another peer.
    """
    function = ""
    try:
        facts = facts_of(message)
        function = facts.function
        check(facts)
        stub = PeerStub(facts, ask, batching)
        try:
            result = check_result(await Waits(contract.invoke(stub, facts.function, facts.args), pending))
        except (ContractFailedError, ServiceError):
            raise
        except Exception as error:  # the contract is foreign code: whatever it raises is its answer, or its fault
            status = getattr(error, "status", None)
            if isinstance(status, int) and 400 <= status < 600:
                raise ContractFailedError(status, str(error)) from error
            raise ContractFaultError(f"the contract raised {type(error).__name__}") from error
        await stub.flush()
    except ContractFailedError as error:
        return Outcome(_refused(message, error.status, str(error)), function, "refused")
    except ContractFaultError as error:
        text = f"the contract failed (reference {_logged(message, function, error)}); the service's log says why"
        return Outcome(_refused(message, FAULT, text), function, "fault")
    except (PeerRefusedError, StreamProtocolError) as error:
        text = f"a read or write failed at the peer (reference {_logged(message, function, error)}); try again"
        return Outcome(failed(message, text), function, "unavailable")
    except UnavailableError as error:
        _log.warning("transaction %s: %s", message.txid[:64], error)
        return Outcome(failed(message, str(error)), function, "unavailable")
    except BadTransactionError as error:
        _log.warning("transaction %s: %s", message.txid[:64], error)
        return Outcome(failed(message, str(error)), function, "bad")
    except Exception as error:  # noqa: BLE001 - one transaction's trouble, never the stream's
        text = f"the contract service failed (reference {_logged(message, function, error)}); its log says why"
        return Outcome(failed(message, text), function, "fault")
    return Outcome(_completed(message, result, stub.event), function, "ok")


def failed(message: Any, text: str) -> Any:
    """The ERROR message that ends a transaction: this peer cannot endorse it, another one might."""
    return shim.ChaincodeMessage(
        type=shim.ChaincodeMessage.ERROR, txid=message.txid, channel_id=message.channel_id, payload=text.encode()
    )


def _refused(message: Any, status: int, text: str) -> Any:
    response = proposal_response_pb2.Response(status=status, message=text)
    return shim.ChaincodeMessage(
        type=shim.ChaincodeMessage.COMPLETED,
        txid=message.txid,
        channel_id=message.channel_id,
        payload=response.SerializeToString(),
    )


def _completed(message: Any, result: bytes, event: tuple[str, bytes] | None) -> Any:
    answer = shim.ChaincodeMessage(
        type=shim.ChaincodeMessage.COMPLETED,
        txid=message.txid,
        channel_id=message.channel_id,
        payload=proposal_response_pb2.Response(status=OK, payload=result).SerializeToString(),
    )
    if event is not None:
        # The peer adds chaincode and transaction itself, so that no contract can speak for another.
        answer.chaincode_event.CopyFrom(chaincode_event_pb2.ChaincodeEvent(event_name=event[0], payload=event[1]))
    return answer


def _logged(message: Any, function: str, error: Exception) -> str:
    """Put the whole error into the log; a reference by which it is found there."""
    reference = secrets.token_hex(4)
    _log.error(
        "transaction %s (%s): %s (reference %s)",
        message.txid[:64],
        function[:64].encode("unicode_escape").decode(),
        error,
        reference,
        exc_info=error,
        extra={"tx_id": message.txid[:64], "reference": reference},
    )
    return reference
