"""The paper's generic data: values of any type, kept with owner and history; the contract never looks inside."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import Any, Final

from wonderland.proofs.records import keys
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.assets import Asset, AssetChange
from wonderland_chaincode.contract import access
from wonderland_chaincode.contract.call import Answer, Call, stored
from wonderland_chaincode.contract.errors import bad_input, conflict, not_allowed, not_there

MAX_HISTORY_BYTES: Final = 2 << 20
"""Of values in one answer: below what a gRPC client takes without being told (4 MiB)."""
MAX_ASSET_BYTES: Final = 1_000_000
"""A Fabric peer reads a history in pages of 100 values, and breaks its stream on a page above 100 MiB."""


async def create(call: Call, argument: tx.CreateAsset) -> Answer:
    """CreateAsset: who creates it, owns it."""
    key = keys.composite(keys.ASSET, argument.id)
    if await call.stub.get(key) is not None:
        raise conflict("ASSET_EXISTS", f"asset {argument.id} exists; UpdateAsset changes it")
    asset = Asset(
        id=argument.id,
        type=argument.type,
        media_type=argument.media_type,
        value=argument.value,
        owner_msp=call.who.msp_id,
        owner=access.name_of(call.who),
        version=1,
        created_ms=call.now_ms,
        updated_ms=call.now_ms,
    )
    return await _write(call, asset)


async def update(call: Call, argument: tx.UpdateAsset) -> Answer:
    """UpdateAsset: by its owner or an admin; it stays the owner's."""
    asset = await _owned(call, argument.id)
    return await _write(
        call,
        replace(
            asset,
            value=argument.value,
            type=asset.type if argument.type is None else argument.type,
            media_type=asset.media_type if argument.media_type is None else argument.media_type,
            version=asset.version + 1,
            updated_ms=call.now_ms,
        ),
    )


async def delete(call: Call, argument: tx.AssetById) -> Answer:
    """DeleteAsset: the state forgets it, the history does not."""
    asset = await _owned(call, argument.id)
    await call.stub.delete(keys.composite(keys.ASSET, asset.id))
    return Answer({"id": asset.id, "deleted": True}, _without_value(asset))


async def read(call: Call, argument: tx.AssetById) -> Answer:
    """ReadAsset."""
    return Answer((await _require(call, argument.id)).to_json())


async def history(call: Call, argument: tx.AssetHistoryOf) -> Answer:
    """AssetHistory: newest first, up to ``limit`` changes or MAX_HISTORY_BYTES; ``more`` says that there are others."""
    changes: list[dict[str, Any]] = []
    more = False
    size = 0
    async for change in call.stub.history(keys.composite(keys.ASSET, argument.id)):
        size += len(change.value)
        if len(changes) >= argument.limit or (changes and size > MAX_HISTORY_BYTES):
            more = True
            break
        entry = AssetChange(
            tx_id=change.tx_id,
            t_ms=change.timestamp_ms,
            deleted=change.is_delete,
            asset=None if change.is_delete else stored(change.value, Asset),
        )
        changes.append(entry.to_json())
    if not changes:
        raise not_there("ASSET_UNKNOWN", f"there never was an asset {argument.id}")
    return Answer({"id": argument.id, "changes": changes, "more": more})


async def _require(call: Call, asset_id: str) -> Asset:
    asset = await call.find_record(keys.composite(keys.ASSET, asset_id), Asset)
    if asset is None:
        raise not_there("ASSET_UNKNOWN", f"there is no asset {asset_id}; CreateAsset makes one")
    return asset


async def _owned(call: Call, asset_id: str) -> Asset:
    asset = await _require(call, asset_id)
    who = call.who
    if who.role != tx.ADMIN and (who.msp_id, who.common_name) != (asset.owner_msp, asset.owner):
        raise not_allowed(
            "ASSET_OF_OTHER_OWNER", f"asset {asset_id} belongs to {asset.owner!r} of {asset.owner_msp}; ask them"
        )
    return asset


async def _write(call: Call, asset: Asset) -> Answer:
    size = len(asset.encode())
    if size > MAX_ASSET_BYTES:
        raise bad_input(
            "ASSET_TOO_LARGE",
            f"asset {asset.id} takes {size} bytes, allowed are {MAX_ASSET_BYTES}; keep large data elsewhere and its "
            "digest here",
        )
    await call.store(keys.composite(keys.ASSET, asset.id), asset)
    return Answer(asset.to_json(), _without_value(asset))


def _without_value(asset: Asset) -> dict[str, Any]:
    document = asset.to_json()
    document["value_sha256"] = hashlib.sha256(document.pop("value").encode("utf-8")).hexdigest()
    return document
