"""One call of the contract: typed records in and out of the stub, and what a transaction answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Final, TypeVar

from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.schema import Record
from wonderland.proofs.records.transactions import ADMIN, MSP_OF_ROLE
from wonderland_chaincode.contract.errors import BROKEN, ContractError
from wonderland_chaincode.stub import Creator, Stub

MAX_STATE_BYTES: Final = 4 << 20
"""A stored asset is a little larger than the argument that brought it; what was stored must be readable."""
MAX_REMEMBERED_BYTES: Final = 8_192
"""Twice a pad with four anchors; what is remembered stays within a few megabytes."""

R = TypeVar("R", bound=Record)


@dataclass(frozen=True, slots=True)
class Answer:
    """What a transaction returns, and the record that its event carries (queries have no event)."""

    result: dict[str, Any]
    event: dict[str, Any] | None = None

    @classmethod
    def of(cls, record: Record) -> Answer:
        """The record both as result and in the event."""
        document = record.to_json()
        return cls(document, document)


@dataclass(frozen=True, slots=True)
class Call:
    """One transaction under way."""

    stub: Stub
    version: str
    """Version of the contract; it goes into the sessions' transcripts."""
    _ahead: dict[str, bytes | None] = field(default_factory=dict)
    """Committed values that were read before they are asked for."""

    @property
    def who(self) -> Creator:
        """Who signed the transaction."""
        return self.stub.creator

    @property
    def now_ms(self) -> int:
        """The transaction's time (Unix, ms), as its proposer said it: the same for every endorser."""
        return self.stub.timestamp_ms

    async def read_ahead(self, keys: Sequence[str]) -> None:
        """Read at once what this transaction will look for; on Fabric each question is a round trip to the peer."""
        self._ahead.update(zip(keys, await self.stub.get_many(keys), strict=True))

    async def find_record(self, key: str, kind: type[R]) -> R | None:
        """The committed record under a key, or None."""
        data = self._ahead[key] if key in self._ahead else await self.stub.get(key)
        return None if data is None else stored(data, kind)

    async def find_first(self, keys: Sequence[str], kind: type[R]) -> R | None:
        """The first of these keys' committed records that is there."""
        await self.read_ahead([key for key in keys if key not in self._ahead])
        for key in keys:
            if (found := await self.find_record(key, kind)) is not None:
                return found
        return None

    async def store(self, key: str, record: Record) -> None:
        """Write a record's canonical bytes under its key."""
        await self.stub.put(key, record.encode())

    async def store_new(self, key: str, record: Record, msp_id: str) -> None:
        """Write the first value of a record that belongs to an organisation (decision 0005).

        From then on the ledger takes no change of it unless a peer of that organisation has endorsed it, too.
        """
        await self.store(key, record)
        await self.stub.require_endorsement(key, sorted({MSP_OF_ROLE[ADMIN], msp_id}))


def stored(data: bytes, kind: type[R]) -> R:
    """A record as it stands in the state; raises ContractError (500) where this version cannot read it."""
    hashable: Any = kind  # mypy holds a class whose instances compare by value for unhashable
    record: R = _remembered(data, hashable) if len(data) <= MAX_REMEMBERED_BYTES else _parsed(data, kind)
    return record


@lru_cache(maxsize=256)
def _remembered(data: bytes, kind: Any) -> Any:
    """The same bytes always give the same record, which nobody can change: a busy pad's survey is parsed once."""
    return _parsed(data, kind)


def _parsed(data: bytes, kind: type[R]) -> R:
    try:
        return kind.decode(data, max_bytes=MAX_STATE_BYTES)
    except ProofError as error:
        raise ContractError(
            BROKEN,
            "STATE_UNREADABLE",
            f"a stored {kind.__name__} does not fit this version of the contract ({error}); upgrade the contract",
        ) from None
