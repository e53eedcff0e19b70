"""The chain's head, kept on the ledger: whoever could rewrite the database could not rewrite that."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Annotated, Any, Final, Protocol

from fastapi import Depends
from starlette.requests import HTTPConnection

from wonderland.proof_contract import Committed, ProofContract
from wonderland.proofs import encoding
from wonderland.proofs.errors import EncodingError
from wonderland.proofs.records.assets import AssetChange
from wonderland.proofs.records.transactions import CreateAsset
from wonderland_backend.audit import queries
from wonderland_backend.audit.store import record
from wonderland_backend.context import ContextDep, part_of
from wonderland_backend.db.engine import Database
from wonderland_fabric_gateway.errors import LedgerError

logger = logging.getLogger(__name__)

TYPE: Final = "wonderland/audit-head"
SERVER: Final = "the server"
ANCHORED: Final = "audit_anchored"


class Assets(Protocol):
    """What is needed of the contract; `ProofContract` has it."""

    async def put_asset(self, argument: CreateAsset) -> Committed:
        """Give an asset this value. Raises `LedgerError`."""

    async def asset_history(self, asset_id: str, limit: int = 1_000) -> tuple[AssetChange, ...]:
        """Its changes, newest first. Raises `LedgerError`."""


@dataclass(frozen=True)
class Anchor:
    """A head of the chain as the ledger has it."""

    seq: int
    sha256: str
    tx_id: str
    t_ms: int


class Anchors:
    """The heads of one installation's log: one asset for each day (UTC), so that each history stays short."""

    def __init__(self, assets: Assets, instance: str) -> None:
        self._assets = assets
        self._instance = instance

    async def put(self, seq: int, sha256: str, now_ms: int) -> Committed:
        """Write a head to the ledger. Raises `LedgerError`."""
        value = encoding.encode({"seq": seq, "sha256": sha256}).decode()
        asset = CreateAsset(id=self._id(_day(now_ms)), type=TYPE, media_type="application/json", value=value)
        return await self._assets.put_asset(asset)

    async def all(self, since_ms: int, until_ms: int) -> list[Anchor]:
        """The heads written on the days of a span, oldest first. Raises `LedgerError`."""
        found: list[Anchor] = []
        day, last = _day(since_ms), _day(until_ms)
        while day <= last:
            changes = await self._assets.asset_history(self._id(day))
            found += [anchor for change in reversed(changes) if (anchor := _anchor(change)) is not None]
            day += timedelta(days=1)
        return found

    def _id(self, day: datetime) -> str:
        return f"audit-head/{self._instance}/{day:%Y-%m-%d}"


async def anchors_of(connection: HTTPConnection, context: ContextDep) -> Anchors | None:
    """A dependency: None where no identity of this backend may anchor the log."""
    contract = part_of(connection, ProofContract)
    return None if contract is None else Anchors(contract, context.instance)


AnchorsDep = Annotated[Anchors | None, Depends(anchors_of)]


class Anchoring:
    """Writes the head to the ledger when there is something new."""

    def __init__(self, database: Database, contract: ProofContract, *, every_s: int, clock: Callable[[], int]) -> None:
        self._database = database
        self._contract = contract
        self._every_s = every_s
        self._clock = clock

    async def run(self, instance: str) -> None:
        """Anchor the log's head again and again, until cancelled."""
        anchors = Anchors(self._contract, instance)
        while True:
            await asyncio.sleep(self._every_s)
            try:
                await self.anchor(anchors)
            except LedgerError as error:
                logger.warning("the audit log could not be anchored on the ledger; trying again: %s", error)
            except Exception:
                logger.exception("the audit log could not be anchored; trying again")

    async def anchor(self, anchors: Anchors) -> bool:
        """Write the head, unless the last row only says that this was done. Raises `LedgerError`."""
        async with self._database.read() as session:
            head = await queries.head(session)
        if head is None or head.act == ANCHORED:
            return False
        done = await anchors.put(head.seq, head.sha256, self._clock())
        detail = {"sha256": head.sha256}
        async with self._database.write() as connection:
            subject = f"audit/{head.seq}"
            await record(connection, SERVER, ANCHORED, subject, detail, done.tx_id, t_ms=self._clock())
        return True


async def instance_of(database: Database) -> str:
    """The installation whose log it is; empty for a server that has never started."""
    async with database.read() as session:
        return await queries.instance(session) or ""


def _day(t_ms: int) -> datetime:
    return datetime.fromtimestamp(t_ms / 1000, UTC).replace(hour=0, minute=0, second=0, microsecond=0)


def _anchor(change: AssetChange) -> Anchor | None:
    """What stands on the ledger under this name but is no head, somebody else has written."""
    if change.asset is None or change.asset.type != TYPE:
        return None
    try:
        value: Any = encoding.decode(change.asset.value)
    except EncodingError:
        return None
    if not isinstance(value, dict) or not isinstance(value.get("seq"), int) or not isinstance(value.get("sha256"), str):
        return None
    return Anchor(value["seq"], value["sha256"], change.tx_id, change.t_ms)
