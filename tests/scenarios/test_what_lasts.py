"""What stays through crashes, and what ends with a certificate."""

import asyncio

import pytest
from kit.scenario_world import people_at

from wonderland.proofs import encoding
from wonderland_fabric_gateway.checkpoints import FileCheckpointer
from wonderland_fabric_gateway.gateway import EndorseError, EvaluateError, StreamError

pytestmark = pytest.mark.timeout(300)
TEXT = {"type": "std_msgs/msg/String", "media_type": "text/plain"}


async def test_a_revoked_drone_is_refused_from_the_next_block_on(people, site):
    session = await site.request()
    lost = site.uav
    stream = lost.network.blocks(start_block=0)
    async with stream:
        await anext(aiter(stream))
        await people.place.revoke(lost.name)
        async with asyncio.timeout(60):
            while True:  # until the peer that this goes by has the block
                try:
                    await lost.query("ReadPad", pad_id=site.pad_id)
                except EvaluateError:
                    break
                await asyncio.sleep(0.02)
        with pytest.raises(EndorseError):
            await lost.endorsed("RequestProof", site.wish("k1"))
        with pytest.raises(StreamError):  # it listens no longer, either
            async with asyncio.timeout(60):
                async for _ in stream:
                    pass
    # Everybody else goes on; its session can be ended without it.
    await site.pad.submit("CancelProof", session_id=session["session_id"], reason="lost")


async def test_what_was_endorsed_before_the_revocation_is_invalid_after_it(people, site):
    """Endorsed in good time, submitted too late: refused by the orderer, or invalid in its block."""
    late = await site.uav.endorsed("RequestProof", site.wish())
    await people.place.revoke(site.uav.name)
    async with asyncio.timeout(60):
        while True:
            try:
                await site.uav.query("ReadPad", pad_id=site.pad_id)
            except EvaluateError:
                break
            await asyncio.sleep(0.02)
    with pytest.raises(Exception, match=r"FORBIDDEN|access denied|BAD_CREATOR_SIGNATURE|revoked"):
        (await (await late.submit()).status()).require_valid()
    listed = await site.mirror.query("ListPrekeys", pad_id=site.pad_id)
    assert [each["prekey_id"] for each in listed["prekeys"]] == ["k0", "k1", "k2"]


def test_state_history_and_events_survive_kill_9(ledger, tag, tmp_path):
    checkpointer = FileCheckpointer(tmp_path / "checkpoint.json")
    asyncio.run(_before(ledger, tag, checkpointer))
    ledger.crash()
    asyncio.run(_after(ledger, tag, checkpointer))


async def _before(ledger, tag, checkpointer):
    async with people_at(ledger) as people:
        uav = people["uav"]
        start = await uav.network.height()
        await uav.submit("CreateAsset", TEXT, id=tag, value="1")
        await uav.submit("UpdateAsset", id=tag, value="2")
        stream = people["mirror"].network.chaincode_events(people.connection.chaincode, start_block=start)
        async with stream:
            event = await asyncio.wait_for(anext(aiter(stream)), 60)
            assert event.name == "AssetCreated"
            checkpointer.save(event.checkpoint)


async def _after(ledger, tag, checkpointer):
    async with people_at(ledger) as people:
        uav = people["uav"]
        assert (await uav.query("ReadAsset", id=tag))["value"] == "2"
        await uav.submit("UpdateAsset", id=tag, value="3")
        changes = (await uav.query("AssetHistory", id=tag))["changes"]
        assert [each["asset"]["value"] for each in changes] == ["3", "2", "1"]
        stream = people["mirror"].network.chaincode_events(people.connection.chaincode, checkpointer=checkpointer)
        heard = []
        async with asyncio.timeout(60), stream:
            async for event in stream:
                record = encoding.decode(event.payload)["record"]
                assert record["id"] == tag
                heard.append(event.tx_id)
                if len(heard) == 2:
                    break
        assert heard == [each["tx_id"] for each in reversed(changes[:2])]
