"""The contract once more, on what the blocks say: the same function, the same reads, and every bit of its outcome.

Reads come from the versions that the endorsers signed; a read that they did not record, or one of theirs that is not
made, is a contradiction. The contract is the installed one, found as a ledger finds it.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from typing import TYPE_CHECKING, Any, Final

from wonderland_evidence.derive import value_at, version_read
from wonderland_evidence.errors import NotCheckedError, StepError
from wonderland_fabric_gateway.embedded.contracts import Contract, load_contract
from wonderland_fabric_gateway.embedded.errors import ContractLoadError
from wonderland_fabric_gateway.signature_policies import VALIDATION_PARAMETER, key_policy
from wonderland_fabric_gateway.verification.channel_trust import APPLICATION

if TYPE_CHECKING:
    from wonderland_evidence.case import Case
    from wonderland_fabric_gateway.embedded.msp import Creator
    from wonderland_fabric_gateway.transactions import Version

OK: Final = 200
CONTRACT: Final = "pol"


def installed_contract() -> Contract:
    """The contract that this verifier has. Raises `NotCheckedError` where it has none."""
    try:
        return load_contract(CONTRACT)
    except ContractLoadError as cause:
        raise NotCheckedError(str(cause)) from cause


class RecordedStub:
    """A transaction's stub that reads what the bundle's blocks wrote."""

    def __init__(self, case: Case, place: Version, creator: Creator) -> None:
        self._case = case
        self._namespace = case.bundle.chaincode
        transaction = case.transaction(place, "it is run again")
        self.invocation = transaction.invocation
        self.creator = creator
        self.channel = transaction.parsed.channel
        self.tx_id = transaction.parsed.tx_id
        self.timestamp_ms = transaction.parsed.timestamp_ms
        self.read: set[str] = set()
        self.ranges: list[tuple[str, str]] = []
        self.writes: dict[str, bytes | None] = {}
        self.policies: dict[str, bytes] = {}
        self.event: tuple[str, bytes] | None = None

    async def get(self, key: str) -> bytes | None:
        """The value that the endorsers saw."""
        self.read.add(key)
        found, version = version_read(self.invocation, self._namespace, key)
        if not found:
            raise StepError(f"the contract read {key!r}, and the endorsers recorded no such read")
        return None if version is None else value_at(self._case, version, self._namespace, key)

    async def get_many(self, keys: Sequence[str]) -> list[bytes | None]:
        """Several of them."""
        return [await self.get(key) for key in keys]

    async def put(self, key: str, value: bytes) -> None:
        """Keep what would be written."""
        self.writes[key] = value

    async def delete(self, key: str) -> None:
        """Keep what would be deleted."""
        self.writes[key] = None
        self.policies.pop(key, None)

    async def require_endorsement(self, key: str, msp_ids: Sequence[str]) -> None:
        """Keep who would have to endorse."""
        self.policies[key] = key_policy(msp_ids)

    async def range(self, start: str, end: str) -> AsyncIterator[tuple[str, bytes]]:
        """The keys that the endorsers saw in that range."""
        self.ranges.append((start, end))
        for access in self.invocation.accesses:
            for query in access.range_queries if access.namespace == self._namespace else ():
                if query.start_key == start:
                    if query.reads is None:
                        raise NotCheckedError("the range was so long that the peers recorded only a summary of it")
                    for each in query.reads:
                        assert each.version is not None
                        yield each.key, value_at(self._case, each.version, self._namespace, each.key)
                    if not query.exhausted:
                        raise StepError("the contract read a range further than the endorsers recorded")
                    return
        raise StepError("the contract read a range that the endorsers did not record")

    async def history(self, key: str) -> AsyncIterator[Any]:
        """No transaction of a session asks for it."""
        yield await self._no_history(key)

    async def _no_history(self, key: str) -> object:
        raise NotCheckedError(f"the history of {key!r} was read, which no block vouches for")

    def set_event(self, name: str, payload: bytes) -> None:
        """Keep the event."""
        self.event = name, payload


def run_again(case: Case, place: Version, contract: Contract) -> None:
    """Run a transaction's function and compare reads, writes, policies, event and answer to the last bit.

    Raises `StepError`.
    """
    transaction = case.transaction(place, "it is run again")
    parsed, invocation = transaction.parsed, transaction.invocation
    assert parsed.creator is not None
    member = case.trust_before(place.block).member(parsed.creator.creator, parsed.timestamp_ms, APPLICATION)
    stub = RecordedStub(case, place, member.creator)
    answer = _finish(contract.invoke(stub, invocation.function, list(invocation.args[1:])))
    _compare("answer", answer, invocation.response.payload if invocation.response.status == OK else None)
    event = invocation.event
    _compare("event", stub.event, None if event is None else (event.name, event.payload))
    namespace = case.bundle.chaincode
    accesses = [each for each in invocation.accesses if each.namespace == namespace]
    _compare(
        "writes",
        stub.writes,
        {write.key: None if write.is_delete else write.value for each in accesses for write in each.writes},
    )
    _compare(
        "endorsement policies",
        stub.policies,
        {
            each.key: dict(each.entries).get(VALIDATION_PARAMETER)
            for access in accesses
            for each in access.metadata_writes
        },
    )
    recorded = {read.key for each in accesses for read in each.reads}
    _compare("reads", stub.read, recorded)


def _finish(coroutine: Any) -> bytes:
    """Drive the contract to its end: its stub never waits."""
    try:
        coroutine.send(None)
    except StopIteration as stop:
        return bytes(stop.value)
    except (StepError, NotCheckedError):
        raise
    except Exception as cause:  # whatever the contract raises would have been its refusal
        raise StepError(f"run again, the contract refuses: {cause}") from cause
    coroutine.close()
    raise StepError("run again, the contract waits for something")


def _compare(what: str, again: object, recorded: object) -> None:
    if again != recorded:
        raise StepError(f"run again, the contract gives other {what} than the endorsed transaction has")
