"""Two who want the same, what was before, and what lies in between."""

import asyncio

import pytest
from kit.scenario_world import also_with_the_node_client

from wonderland_fabric_gateway.gateway import CommitError, EndorseError

pytestmark = pytest.mark.timeout(300)
TEXT = {"type": "std_msgs/msg/String", "media_type": "text/plain"}


@also_with_the_node_client
async def test_two_drones_that_want_one_prekey(people, site):
    """Both are endorsed on the same state; one is invalid, and the contract then tells it why."""
    wish = site.wish("k0")
    outcomes = await people.outcomes([await site.uav.endorsed("RequestProof", wish) for _ in range(2)])
    assert sorted(outcomes) == ["MVCC_READ_CONFLICT", "VALID"]
    text = await site.uav.is_refused(409, "PREKEY_USED", "RequestProof", site.wish("k0"))
    assert "take another" in text


async def test_requests_with_different_prekeys_do_not_conflict(people, site):
    transactions = [await site.uav.endorsed("RequestProof", site.wish(f"k{index}")) for index in range(3)]
    assert await people.outcomes(transactions) == ["VALID"] * 3


@also_with_the_node_client
async def test_an_update_of_what_has_changed_meanwhile_is_invalid_and_changes_nothing(people, tag):
    uav = people["uav"]
    await uav.submit("CreateAsset", TEXT, id=tag, value="0")
    stale = await uav.endorsed("UpdateAsset", id=tag, value="stale")
    await uav.submit("UpdateAsset", id=tag, value="fresh")
    status = await (await stale.submit()).status()
    assert status.code_name == "MVCC_READ_CONFLICT"
    with pytest.raises(CommitError) as raised:
        status.require_valid()
    assert raised.value.is_conflict
    await people.everywhere(status.block_number)
    assert (await uav.query("ReadAsset", id=tag))["value"] == "fresh"
    assert len((await uav.query("AssetHistory", id=tag))["changes"]) == 2


async def test_a_transaction_that_is_sent_twice_counts_once(people, tag):
    uav = people["uav"]
    transaction = await uav.endorsed("CreateAsset", TEXT, id=tag, value="once")
    first = await (await transaction.submit()).status()
    assert first.code_name == "VALID"
    again = await (await transaction.submit()).status()
    assert (again.code_name, again.block_number) == ("VALID", first.block_number)
    # The repetition is in a block of its own, marked as what it is.
    network = people["mirror"].network
    async with asyncio.timeout(60), network.filtered_blocks(start_block=first.block_number) as stream:
        found = []
        async for block in stream:
            found += [each.validation_code for each in block.transactions if each.tx_id == transaction.tx_id]
            if len(found) == 2:
                break
    assert found == [0, 9]
    assert len((await uav.query("AssetHistory", id=tag))["changes"]) == 1


async def test_many_writers_of_one_asset_all_get_through(people, tag):
    """Each conflict is tried again; nothing is lost and nothing written twice."""
    uav = people["uav"]
    await uav.submit("CreateAsset", TEXT, id=tag, value="start")
    values = [f"value-{index}" for index in range(4)]

    async def write(value):
        while True:
            try:
                return await uav.submit("UpdateAsset", id=tag, value=value)
            except (CommitError, EndorseError) as error:
                if not getattr(error, "is_conflict", False) and not getattr(error, "is_mismatch", False):
                    raise

    await asyncio.gather(*(write(value) for value in values))
    changes = (await uav.query("AssetHistory", id=tag))["changes"]
    assert sorted(each["asset"]["value"] for each in changes) == ["start", *values]


@also_with_the_node_client
async def test_history_is_told_newest_first_with_deletions(people, tag):
    uav = people["uav"]
    done = [(await uav.submitted("CreateAsset", TEXT, id=tag, value="1"))[0]]
    done += [(await uav.submitted("UpdateAsset", id=tag, value=value))[0] for value in ("2", "3")]
    done.append((await uav.submitted("DeleteAsset", id=tag))[0])
    done.append((await uav.submitted("CreateAsset", TEXT, id=tag, value="again"))[0])
    answer = await uav.query("AssetHistory", id=tag)
    assert [each["tx_id"] for each in answer["changes"]] == [each.tx_id for each in reversed(done)]
    assert [each["deleted"] for each in answer["changes"]] == [False, True, False, False, False]
    assert [each.get("asset", {}).get("value") for each in answer["changes"]] == ["again", None, "3", "2", "1"]
    short = await uav.query("AssetHistory", id=tag, limit=2)
    assert (short["changes"], short["more"]) == (answer["changes"][:2], True)


async def test_assets_are_their_owners(people, tag):
    await people["uav"].submit("CreateAsset", TEXT, id=tag, value="mine")
    for function, fields in (("UpdateAsset", {"value": "yours"}), ("DeleteAsset", {})):
        await people["fleet_operator"].is_refused(403, "ASSET_OF_OTHER_OWNER", function, id=tag, **fields)
    await people["admin"].submit("DeleteAsset", id=tag)
    await people["uav"].finds_nothing("ReadAsset", id=tag)


@also_with_the_node_client
async def test_a_range_ends_where_the_next_pad_begins(people, site_of, tag):
    """The identifiers of these pads begin alike, and their prekeys lie side by side in the state."""
    site = await site_of()
    near = await type(site)(people, f"{tag}-padmsp-1", "PadMSP").ready()
    await site.offer(20)
    listed = [(await site.uav.query("ListPrekeys", pad_id=each.pad_id, limit=100))["prekeys"] for each in (site, near)]
    assert [each["prekey_id"] for each in listed[0]] == sorted(f"k{number}" for number in range(23))
    assert [each["prekey_id"] for each in listed[1]] == ["k0", "k1", "k2"]
    assert len((await site.uav.query("ListPrekeys", pad_id=site.pad_id))["prekeys"]) == 10
