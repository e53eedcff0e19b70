"""``wonderland ros1 read``, ``history`` and ``delete``: assets by hand, as the bridge's own identity."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import click

from wonderland.asset_contract import AssetContract
from wonderland.proofs.records.assets import Asset
from wonderland.toml_settings import SettingsError
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_ros_bridge.config_option import config
from wonderland_ros_bridge.either import Settings, load, message_reader
from wonderland_ros_bridge.errors import BridgeError
from wonderland_ros_bridge.ledger import envelope

_PREFIXES = {"ros1": "ros1", "cdr": "ros2"}
_asset = click.argument("asset_id", metavar="TOPIC_OR_ASSET")


@click.command()
@config
@_asset
def read(*, path: Path, asset_id: str) -> None:
    """Show an asset as it stands, its messages decoded. A name with a slash first is a topic of this bridge."""

    async def work(ledger: AssetContract, name: str) -> Any:
        asset = await ledger.read_asset(name)
        if asset is None:
            raise BridgeError(f"there is no asset {name}")
        return await _shown(ledger, asset)

    _run(path, asset_id, work)


@click.command()
@config
@_asset
@click.option("--limit", type=click.IntRange(1, 1_000), default=20, show_default=True, help="How many changes.")
def history(*, path: Path, asset_id: str, limit: int) -> None:
    """Show an asset's changes, newest first, each with its transaction; also of one that was deleted."""

    async def work(ledger: AssetContract, name: str) -> Any:
        changes, more = await ledger.asset_history(name, limit)
        return {
            "id": name,
            "changes": [
                {"tx_id": each.tx_id, "t_ms": each.t_ms, "deleted": each.deleted}
                | ({} if each.asset is None else await _shown(ledger, each.asset))
                for each in changes
            ],
            "more": more,
        }

    _run(path, asset_id, work)


@click.command()
@config
@_asset
def delete(*, path: Path, asset_id: str) -> None:
    """Delete an asset of this bridge: the ledger's state forgets it, its history does not."""

    async def work(ledger: AssetContract, name: str) -> Any:
        done = await ledger.delete_asset(name)
        return {"id": name, "deleted": True, "tx_id": done.tx_id}

    _run(path, asset_id, work)


def _run(path: Path, asset_id: str, work: Callable[[AssetContract, str], Awaitable[Any]]) -> None:
    async def whole() -> Any:
        settings = load(path)
        name = (
            envelope.topic_asset_id(settings.prefix, settings.bridge, asset_id)
            if asset_id.startswith("/")
            else asset_id
        )
        async with _ledger(settings) as ledger:
            return await work(ledger, name)

    try:
        click.echo(json.dumps(asyncio.run(whole()), indent=2))
    except (SettingsError, BridgeError, LedgerError) as error:
        raise click.ClickException(str(error)) from error


@contextlib.asynccontextmanager
async def _ledger(settings: Settings) -> AsyncIterator[AssetContract]:
    where = Connection.load(settings.ledger.connection)
    who, signer = where.identity(settings.ledger.identity), where.signer(settings.ledger.identity)
    async with where.open_channel() as channel:
        yield AssetContract(Gateway(channel, who, signer).network(where.channel), where.chaincode)


async def _shown(ledger: AssetContract, asset: Asset) -> dict[str, Any]:
    """For people: with the messages decoded where they are a bridge's, else with the value as it is."""
    document = asset.to_json()
    if asset.media_type != envelope.MEDIA_TYPE:
        return document
    del document["value"]
    batch = envelope.parse(asset.value)
    stored = await ledger.read_asset(
        envelope.definition_asset_id(_PREFIXES[batch.encoding], batch.bridge, batch.type, batch.type_hash)
    )
    to_json = message_reader(batch, None if stored is None else stored.value)
    document["topic"] = batch.topic
    document["messages"] = [
        {"seq": each.seq, "t_ms": each.t_ms, "message": to_json(each.data)}
        if each.data is not None
        else {"seq": each.seq, "t_ms": each.t_ms, "sha256": each.sha256, "size": each.size}
        for each in batch.messages
    ]
    return document
