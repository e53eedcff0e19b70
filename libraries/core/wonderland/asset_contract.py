"""The contract's assets as one identity writes and reads them, and what is committed, block by block.

A block tells an asset's value, which the contract's event leaves out: a listener needs no second question, and sees
each version of an asset that is changed often.
"""

from __future__ import annotations

from collections.abc import AsyncGenerator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from wonderland.proof_contract import AwayError, Committed, ProofContract, RefusedError, parsed_answer, translated
from wonderland.proofs import encoding
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records import keys
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.assets import Asset, AssetChange
from wonderland_fabric_gateway.errors import IdentityError
from wonderland_fabric_gateway.gateway.errors import GatewayError

if TYPE_CHECKING:
    from wonderland.proofs.records.schema import Record
    from wonderland_fabric_gateway.identity import Identity
    from wonderland_fabric_gateway.transactions import Transaction

_NOT_THERE = 404
MAX_EVENT_BYTES = 4 << 20
MAX_ANSWER_BYTES = 4 << 20
"""Of a history, which the contract bounds at 2 MiB of values."""

__all__ = ["AssetContract", "AwayError", "Committed", "CommittedBlock", "CommittedEvent", "RefusedError"]


@dataclass(frozen=True, slots=True)
class CommittedEvent:
    """An event of a valid transaction; ``asset`` is what that transaction stored, where it stored one."""

    name: str
    tx_id: str
    t_ms: int
    sender: str
    """Who signed it: ``MSP/common name``."""
    record: dict[str, Any]
    asset: Asset | None


@dataclass(frozen=True, slots=True)
class CommittedBlock:
    """A block's events of this contract, in the order of its transactions."""

    number: int
    events: tuple[CommittedEvent, ...]


class AssetContract(ProofContract):
    """Assets on one channel. Every method raises `RefusedError` and `AwayError`.

    A change is submitted once: after a conflict, or an answer that was lost, only the caller can tell whether the
    ledger has it already.
    """

    async def create_asset(self, argument: tx.CreateAsset) -> Committed:
        """Store a new value; who creates it, owns it."""
        return await self._submit_once("CreateAsset", argument)

    async def update_asset(self, argument: tx.UpdateAsset) -> Committed:
        """Replace a value of one's own."""
        return await self._submit_once("UpdateAsset", argument)

    async def delete_asset(self, asset_id: str) -> Committed:
        """Take a value of one's own out of the state; the history keeps it."""
        return await self._submit_once("DeleteAsset", tx.AssetById(id=asset_id))

    async def read_asset(self, asset_id: str) -> Asset | None:
        """An asset as it stands; None where there is none."""
        try:
            return parsed_answer(Asset, await self._evaluate("ReadAsset", tx.AssetById(id=asset_id)))
        except RefusedError as error:
            if error.status == _NOT_THERE:
                return None
            raise

    async def asset_history(self, asset_id: str, limit: int = 100) -> tuple[tuple[AssetChange, ...], bool]:
        """An asset's changes, newest first, and whether there are more; nothing where there never was one."""
        try:
            argument = tx.AssetHistoryOf(id=asset_id, limit=limit)
            answer = await self._evaluate("AssetHistory", argument, max_bytes=MAX_ANSWER_BYTES)
        except RefusedError as error:
            if error.status == _NOT_THERE:
                return (), False
            raise
        changes = answer.get("changes")
        if not isinstance(changes, list):
            raise RefusedError(0, "BAD_ANSWER", "the contract's history of an asset is no list")
        return tuple(parsed_answer(AssetChange, each) for each in changes), answer.get("more") is True

    async def committed(self, start_block: int) -> AsyncGenerator[CommittedBlock]:
        """Every block from ``start_block`` on, for ever, through interruptions."""
        stream = self._network.blocks(start_block=start_block, reconnect=True)
        try:
            async for block in stream:
                found = (self._event_of(each) for each in block.transactions if each.is_valid)
                yield CommittedBlock(block.number, tuple(each for each in found if each is not None))
        except GatewayError as error:
            raise translated(error) from error
        finally:
            stream.close()

    async def _submit_once(self, function: str, argument: Record) -> Committed:
        try:
            done = await self._contract.submit(function, argument.encode())
        except GatewayError as error:
            raise translated(error) from error
        return Committed(done.tx_id, done.block_number)

    def _event_of(self, transaction: Transaction) -> CommittedEvent | None:
        event = transaction.event
        if event is None or transaction.creator is None or event.chaincode != self._contract.chaincode:
            return None
        try:
            payload = encoding.decode(event.payload, max_bytes=MAX_EVENT_BYTES)
            record = payload.get("record") if isinstance(payload, dict) else None
            asset = _asset_of(transaction, self._contract.chaincode)
        except ProofError:
            return None  # of another version of the contract
        if not isinstance(record, dict):
            return None
        sender = _sender_of(transaction.creator)
        return CommittedEvent(event.name, transaction.tx_id, transaction.timestamp_ms, sender, record, asset)


def _sender_of(creator: Identity) -> str:
    try:
        return f"{creator.msp_id}/{creator.common_name}"
    except IdentityError:
        return f"{creator.msp_id}/"


def _asset_of(transaction: Transaction, chaincode: str) -> Asset | None:
    for namespace, write in transaction.writes:
        if namespace == chaincode and not write.is_delete and keys.split(write.key)[0] == keys.ASSET:
            return Asset.decode(write.value, max_bytes=MAX_EVENT_BYTES)
    return None
