"""The official Node client, unmodified, against the embedded ledger.

It is installed by `npm ci` from package-lock.json into node_modules beside this file; without Node.js, npm or a
registry the tests skip and say so.
"""

import asyncio
import json
from pathlib import Path

import pytest
from kit.node_client import program

HERE = Path(__file__).parent
pytestmark = [pytest.mark.node, pytest.mark.timeout(300)]


@pytest.fixture(scope="module")
def node():
    """The node program, with the client installed."""
    return program()


@pytest.fixture
def run(node):
    async def run_scenario(world, scenario, *args):
        process = await asyncio.create_subprocess_exec(
            node,
            HERE / "client.mjs",
            world.ledger.directory.connection_file,
            scenario,
            *map(str, args),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        try:
            output, errors = await asyncio.wait_for(process.communicate(), 60)
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()
        assert process.returncode == 0, errors.decode()
        return json.loads(output)

    return run_scenario


async def test_submit_and_evaluate(world, run):
    answer = await run(world, "transactions")
    assert (answer["submitted"], answer["evaluated"], answer["asynchronous"]) == ("value", "value", "async")
    assert (answer["successful"], answer["code"]) == (True, 0)
    assert answer["transient"] == "with transient"
    location = world.chain.reader.transaction(answer["transactionId"])
    assert (location.block, location.code) == (answer["blockNumber"], 0)
    assert await world.contract().evaluate("get", "node3") == b"with transient"
    assert all(b"not on the ledger" not in world.chain.block(number) for number in range(world.chain.height))


async def test_offline_signing(world, run):
    answer = await run(world, "offline")
    assert answer["evaluated"] == answer["endorsed"] == "signed elsewhere"
    assert answer["successful"] is True
    assert "signing" in answer["unsigned"]["message"].lower()
    assert await world.contract().evaluate("get", "offline") == b"signed elsewhere"


async def test_errors_and_their_details(world, run):
    answer = await run(world, "errors")
    address = world.connection.gateway.address
    endorse = answer["endorse"]
    assert (endorse["name"], endorse["grpcCode"]) == ("EndorseError", 10)
    assert endorse["message"] == "10 ABORTED: failed to endorse transaction, see attached details for more info"
    assert endorse["details"] == [
        {"address": address, "mspId": "AuthorityMSP", "message": "chaincode response 403, NOT_YOURS: ask its operator"}
    ]
    assert len(endorse["transactionId"]) == 64
    evaluate = answer["evaluate"]
    assert (evaluate["name"], evaluate["grpcCode"]) == ("GatewayError", 2)
    assert evaluate["message"].endswith("chaincode response 404, NOT_FOUND: no such pad")
    assert evaluate["details"][0]["message"] == "chaincode response 404, NOT_FOUND: no such pad"
    assert answer["crash"]["details"][0]["message"].startswith("chaincode response 500, the contract failed (reference")
    assert "not issued by a CA of that organisation" in answer["impostor"]["details"][0]["message"]
    assert (answer["policy"]["name"], answer["policy"]["grpcCode"]) == ("CommitError", 10)
    assert "ENDORSEMENT_POLICY_FAILURE" in answer["policy"]["message"]
    assert (answer["organisation"]["name"], answer["organisation"]["grpcCode"]) == ("EndorseError", 14)
    assert answer["conflict"] == [0, 11]


async def test_checkpointed_events_over_restarts(tmp_path, open_world, run):
    """Nothing is missed and nothing seen twice while the ledger is restarted in between, twice."""
    seen, expected = [], []
    for round_, count in enumerate((3, 5, 4)):
        async with open_world(tmp_path / "ledger") as world:
            for index in range(4):
                done = await world.contract().submit("put", "k", f"{round_}.{index}", "Told")
                expected.append(["Told", f"{round_}.{index}", done.block_number, done.tx_id])
                await world.contract().submit("put", "silent", "x")
            seen += (await run(world, "events", tmp_path / "events.json", count))["events"]
    assert seen == expected


async def test_checkpointed_blocks_over_restarts(tmp_path, open_world, run):
    numbers = []
    for count in (2, 3):
        async with open_world(tmp_path / "ledger") as world:
            for _ in range(3):
                await world.contract().submit("put", "k", "v")
            numbers += (await run(world, "checkpointedBlocks", tmp_path / "blocks.json", count))["numbers"]
    assert numbers == [0, 1, 2, 3, 4]


async def test_block_streams(world, run):
    first = await world.contract().submit("put", "a", "1", "Happened")
    stale = await world.contract().propose("increment", "n").endorse()
    await world.contract().submit("increment", "n")
    await (await stale.submit()).status()
    answer = await run(world, "blocks", 4)
    assert [each["number"] for each in answer["full"]] == [0, 1, 2, 3]
    assert answer["withPrivateData"] == [0, 1, 2, 3]
    assert all(each["dataHash"] == each["ownDataHash"] for each in answer["full"])
    assert [each["previous"] for each in answer["full"][1:]] == [
        world.chain.reader._db.execute("SELECT hex(header_hash) FROM block WHERE number=?", (number,))
        .fetchone()[0]
        .lower()
        for number in range(3)
    ]
    filtered = answer["filtered"]
    assert [each["number"] for each in filtered] == [0, 1, 2, 3]
    assert {each["channel"] for each in filtered} == {"wonderland"}
    assert filtered[1]["transactions"] == [[first.tx_id, 0, ["Happened"]]]
    assert filtered[3]["transactions"][0][1:] == [11, []]


async def test_a_stream_of_what_comes_next(world, run):
    assert await run(world, "next") == {"event": "After"}
