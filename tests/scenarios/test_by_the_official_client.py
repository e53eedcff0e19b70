"""What the official Node client hears of both ledgers, and which errors it makes of their refusals.

The scenarios that change something are in the other files, each played by both clients.
"""

import asyncio

import pytest
from kit.node_client import NodeError
from kit.scenario_world import people_at

from wonderland.proofs import encoding
from wonderland_fabric_gateway.gateway import EndorseError

pytestmark = [pytest.mark.node, pytest.mark.timeout(300), pytest.mark.parametrize("client", ["node"])]
TEXT = {"type": "std_msgs/msg/String", "media_type": "text/plain", "value": "1"}


@pytest.fixture
async def observer(ledger, people):
    """The mirror with our client, to compare with."""
    async with people_at(ledger) as others:
        yield others["mirror"]


async def test_events_go_on_from_a_checkpoint(people, observer, tag, tmp_path):
    """Half of them, the other half, and never one twice; the same as our client hears."""
    start = await observer.network.height()
    names = [f"{tag}-{index}" for index in range(4)]
    for name in names:
        await people["uav"].submit("CreateAsset", TEXT, id=name)
    ask = {"who": "mirror", "startBlock": start, "checkpointFile": str(tmp_path / "checkpoint.json"), "count": 2}
    heard = [event for _ in range(2) for event in await people.bridge.ask("events", **ask)]
    assert [encoding.decode(each["payload"].encode())["record"]["id"] for each in heard] == names
    stream = observer.network.chaincode_events(people.connection.chaincode, start_block=start)
    async with asyncio.timeout(60), stream:
        for each in heard:
            event = await anext(aiter(stream))
            assert (each["name"], each["txId"], each["blockNumber"]) == (event.name, event.tx_id, event.block_number)
            assert each["payload"].encode() == event.payload


async def test_blocks_and_their_outlines(people, observer, tag):
    start = await observer.network.height()
    uav = people["uav"]
    await uav.submit("CreateAsset", TEXT, id=tag)
    stale = await uav.endorsed("UpdateAsset", id=tag, value="stale")
    await uav.submit("UpdateAsset", id=tag, value="fresh")
    await people.everywhere((await (await stale.submit()).status()).block_number)
    blocks = await people.bridge.ask("blocks", who="mirror", startBlock=start, count=3)
    outlines = await people.bridge.ask("filteredBlocks", who="mirror", startBlock=start, count=3)
    async with asyncio.timeout(60), observer.network.blocks(start_block=start) as stream:
        for block, outline in zip(blocks, outlines, strict=True):
            ours = await anext(aiter(stream))
            assert (block["number"], block["previous"]) == (ours.number, ours.header.previous_hash.hex())
            assert block["dataHash"] == ours.header.data_hash.hex()
            assert bytes.fromhex(block["codes"]) == bytes(each.validation_code for each in ours.transactions)
            assert [each[:2] for each in outline["transactions"]] == [
                [each.tx_id, each.validation_code] for each in ours.transactions
            ]
    # An outline names also the event of an invalid transaction; that it did not happen is in the code.
    assert [each["transactions"][0][1:] for each in outlines] == [
        [0, ["AssetCreated"]],
        [0, ["AssetUpdated"]],
        [11, ["AssetUpdated"]],
    ]


async def test_each_refusal_is_the_clients_own_kind_of_error(people, tag):
    async def refused(who, name, argument, *organisations):
        request = {"who": who, "name": name, "argument": encoding.encode(argument).decode()}
        with pytest.raises((EndorseError, NodeError)) as raised:
            await people.bridge.ask("submitTransaction", endorsedBy=list(organisations), **request)
        return raised.value

    people.bridge.behind_ms = people.behind_ms
    by_the_contract = await refused("uav", "RetirePad", {"pad_id": tag, "reason": "x"})
    assert (by_the_contract.node_name, by_the_contract.node_code) == ("EndorseError", 10)
    assert by_the_contract.message == "10 ABORTED: failed to endorse transaction, see attached details for more info"
    assert by_the_contract.chaincode_response.message.startswith("ROLE_NOT_ALLOWED: ")
    assert by_the_contract.details[0].msp_id == "AuthorityMSP"

    by_the_peers = await refused("uav", "CreateAsset", {**TEXT, "id": tag}, "AuthorityMSP")
    assert (by_the_peers.node_name, by_the_peers.node_code) == ("CommitError", 10)
    assert "ENDORSEMENT_POLICY_FAILURE" in by_the_peers.message

    by_nobody = await refused("uav", "CreateAsset", {**TEXT, "id": tag}, "FleetMSP")
    assert by_nobody.node_name == "EndorseError"
