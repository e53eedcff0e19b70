"""Orders of a robot's own programs: create, change, read, delete an asset or ask for its history, as JSON texts.

Each order has an answer. What is written stays within this bridge's own names: a topic of ROS has no access control,
and the bridge's certificate may own more than the bridge does.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal, Protocol

from msgspec import Meta, MsgspecError, Struct
from msgspec import json as msgspec_json

from wonderland.proof_contract import AwayError, Committed, RefusedError
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.assets import Asset, AssetChange
from wonderland_ros_bridge.ledger import envelope

MAX_ORDER_BYTES: Final = 600_000


class Order(Struct, frozen=True, forbid_unknown_fields=True):
    """One order. ``asset``: an id, or a topic of this bridge (with a slash first)."""

    do: Literal["create", "update", "read", "delete", "history"]
    asset: Annotated[str, Meta(min_length=1, max_length=255)]
    value: str | None = None
    type: str | None = None
    media_type: str | None = None
    limit: Annotated[int, Meta(ge=1, le=100)] = 20
    request: Annotated[str, Meta(max_length=100)] = ""
    """Comes back with the answer."""


class Ledger(Protocol):
    """Assets on the ledger (``wonderland.asset_contract.AssetContract``)."""

    async def create_asset(self, argument: tx.CreateAsset) -> Committed:
        """Store a new value."""
        ...

    async def update_asset(self, argument: tx.UpdateAsset) -> Committed:
        """Replace a value."""
        ...

    async def delete_asset(self, asset_id: str) -> Committed:
        """Take a value out of the state."""
        ...

    async def read_asset(self, asset_id: str) -> Asset | None:
        """An asset as it stands."""
        ...

    async def asset_history(self, asset_id: str, limit: int = 100) -> tuple[tuple[AssetChange, ...], bool]:
        """Its changes, newest first, and whether there are more."""
        ...


class Orders:
    """Carries orders out, one after the other."""

    def __init__(self, ledger: Ledger, *, prefix: str, bridge: str) -> None:
        self._ledger = ledger
        self._prefix = prefix
        self._bridge = bridge

    async def carry_out(self, text: bytes) -> str:
        """The answer to an order: JSON with ``ok``, and what was asked for or ``code`` and ``reason``."""
        request = ""
        try:
            order = msgspec_json.decode(text, type=Order)
            request = order.request
            answer = {"ok": True, **await self._done(order)}
        except (MsgspecError, ProofError, RecursionError) as error:
            answer = {"ok": False, "code": "BAD_ORDER", "reason": str(error)[:300]}
        except RefusedError as error:
            answer = {"ok": False, "code": error.code, "reason": error.text}
        except AwayError as error:
            # A change may yet be committed: who gave the order has to look before ordering it again.
            answer = {"ok": False, "code": "LEDGER_AWAY", "reason": str(error), "tx_id": error.tx_id}
        return msgspec_json.encode({"request": request, **answer}).decode()

    async def _done(self, order: Order) -> dict[str, Any]:
        name = order.asset
        if name.startswith("/"):
            name = envelope.topic_asset_id(self._prefix, self._bridge, name)
        if order.do == "read":
            asset = await self._ledger.read_asset(name)
            if asset is None:
                raise RefusedError(404, "ASSET_UNKNOWN", f"there is no asset {name}")
            return {"asset": asset.to_json()}
        if order.do == "history":
            changes, more = await self._ledger.asset_history(name, order.limit)
            return {"changes": [each.to_json() for each in changes], "more": more}
        own = f"{self._prefix}/{self._bridge}/"
        if not name.startswith(own):
            raise RefusedError(403, "ASSET_OF_OTHER_BRIDGE", f"this bridge changes only assets under {own}")
        if order.do == "delete":
            done = await self._ledger.delete_asset(name)
        else:
            done = await self._write(order, name)
        return {"id": name, "tx_id": done.tx_id}

    async def _write(self, order: Order, name: str) -> Committed:
        given = {"id": name, "value": order.value, "type": order.type, "media_type": order.media_type}
        document = {field: value for field, value in given.items() if value is not None}
        if order.do == "create":
            return await self._ledger.create_asset(tx.CreateAsset.parse({"media_type": "text/plain", **document}))
        return await self._ledger.update_asset(tx.UpdateAsset.parse(document))
