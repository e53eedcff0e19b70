"""Assets as their users see them, on an embedded ledger with the contract itself."""

from __future__ import annotations

import pytest
from kit.ros1 import running_ledger

from wonderland.asset_contract import AssetContract
from wonderland.proof_contract import RefusedError
from wonderland.proofs.records import transactions as tx
from wonderland_fabric_gateway.gateway import Gateway


@pytest.fixture
async def assets(tmp_path):
    """Assets as the drone sees them, and as the pad does."""
    async with running_ledger(tmp_path / "ledger") as ledger, ledger.connection.open_channel() as channel:
        where = ledger.connection

        def of(name):
            network = Gateway(channel, where.identity(name), where.signer(name)).network(where.channel)
            return AssetContract(network, where.chaincode)

        yield of("uav"), of("pad")


def new(name="a", value="v", kind="a/B"):
    return tx.CreateAsset(id=name, type=kind, media_type="text/plain", value=value)


async def test_a_value_is_made_changed_read_and_deleted_by_its_owner(assets):
    mine, theirs = assets
    await mine.create_asset(new())
    with pytest.raises(RefusedError, match="ASSET_EXISTS"):
        await theirs.create_asset(new())
    await mine.update_asset(tx.UpdateAsset(id="a", value="w"))
    found = await theirs.read_asset("a")
    assert (found.value, found.version, found.owner) == ("w", 2, "uav")
    for change in (theirs.update_asset(tx.UpdateAsset(id="a", value="x")), theirs.delete_asset("a")):
        with pytest.raises(RefusedError, match="ASSET_OF_OTHER_OWNER"):
            await change
    await mine.delete_asset("a")
    assert await mine.read_asset("a") is None
    changes, more = await theirs.asset_history("a")
    assert [(each.deleted, each.asset and each.asset.value) for each in changes] == [
        (True, None),
        (False, "w"),
        (False, "v"),
    ]
    assert not more
    assert await mine.asset_history("never") == ((), False)


async def test_a_history_of_large_values_can_be_read(assets):
    mine, _ = assets
    await mine.create_asset(new(value="x" * 400_000))
    for _ in range(6):
        await mine.update_asset(tx.UpdateAsset(id="a", value="y" * 400_000))
    changes, more = await mine.asset_history("a")
    assert (len(changes), more) == (5, True), "up to 2 MiB of values, more than one record may have"


async def test_blocks_tell_values_and_who_signed(assets):
    mine, theirs = assets
    start = await mine.height()
    await mine.create_asset(new())
    with pytest.raises(RefusedError):
        await theirs.create_asset(new())
    await theirs.create_asset(new("b", "w"))
    await mine.delete_asset("a")
    found = []
    async for block in theirs.committed(start):
        found += [(each.name, each.sender, each.record["id"], each.asset and each.asset.value) for each in block.events]
        if len(found) == 3:
            break
    assert found == [
        ("AssetCreated", "FleetMSP/uav", "a", "v"),
        ("AssetCreated", "PadMSP/pad", "b", "w"),
        ("AssetDeleted", "FleetMSP/uav", "a", None),
    ]
