"""The bridge with a real master and real rospy nodes: topics become assets, and topics again, through all restarts."""

from __future__ import annotations

import asyncio
import itertools
import json
import subprocess
import sys

import pytest
from kit.ros1 import BridgeProcess, Master, Peer, Route, need_ros, running_ledger, write_config

from wonderland.asset_contract import AssetContract
from wonderland.proofs.records import transactions as tx
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_ros_bridge.ledger import envelope

FIX = "sensor_msgs/NavSatFix"
TYPES = [
    "std_msgs/String",
    "std_msgs/Bool",
    "std_msgs/Byte",
    "std_msgs/Char",
    "std_msgs/ColorRGBA",
    "std_msgs/Duration",
    "std_msgs/Empty",
    "std_msgs/Float32MultiArray",
    "std_msgs/Float64",
    "std_msgs/Header",
    "std_msgs/Int64",
    "std_msgs/Time",
    "std_msgs/UInt8MultiArray",
    "geometry_msgs/PoseWithCovarianceStamped",
    "geometry_msgs/TwistWithCovariance",
    "geometry_msgs/PolygonStamped",
    "geometry_msgs/WrenchStamped",
    "geometry_msgs/PoseArray",
    "geometry_msgs/TransformStamped",
    "geometry_msgs/InertiaStamped",
    "sensor_msgs/NavSatFix",
    "sensor_msgs/Imu",
    "sensor_msgs/Image",
    "sensor_msgs/LaserScan",
    "sensor_msgs/PointCloud2",
    "sensor_msgs/JointState",
    "sensor_msgs/CameraInfo",
    "sensor_msgs/MagneticField",
    "sensor_msgs/BatteryState",
    "sensor_msgs/CompressedImage",
    "sensor_msgs/MultiDOFJointState",
    "sensor_msgs/Range",
]


@pytest.fixture
async def master(tmp_path):
    need_ros()
    made = Master(tmp_path)
    await made.start()
    yield made
    await made.stop()


@pytest.fixture
async def peer(master):
    made = await Peer.start("peer", master)
    yield made
    await made.stop()


async def joined(peer, topic="/fix", kind=FIX, at="/ledger/drone_a"):
    """The peer publishes a topic, and hears what comes of it."""
    await peer.asked("subscribe", topic=f"{at}{topic}", type=kind)
    await peer.asked("advertise", topic=topic, type=kind)
    await peer.asked("wait", topic=topic)


async def sent(peer, topic, seeds):
    return [(await peer.asked("fill", topic=topic, seed=seed))["hex"] for seed in seeds]


async def heard(peer, count):
    return [line["hex"] for line in await peer.until("message", count=count)]


def wonderland(*arguments):
    """``wonderland ros1``: its exit code, and what it says."""
    command = [sys.executable, "-m", "wonderland.cli", "ros1", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


async def test_any_topic_of_any_type_comes_out_as_it_went_in(tmp_path, master, peer):
    """32 types in one run, by a pattern: covariances, NaN and nested arrays byte for byte, both bridges knowing none."""
    topics = {f"/all/{kind.replace('/', '_').lower()}": kind for kind in TYPES}
    assert len(topics) >= 30
    async with Route(tmp_path, master, to_ledger='topic = "/all/*"\nkeep = "each"'):
        for topic, kind in topics.items():
            await peer.asked("subscribe", topic=f"/ledger/drone_a{topic}", type=kind)
            await peer.asked("advertise", topic=topic, type=kind)
        for topic in topics:
            await peer.asked("wait", topic=topic)
        expected = {topic: await sent(peer, topic, range(3)) for topic in topics}
        found = {topic: [] for topic in topics}
        for line in await peer.until("message", count=3 * len(topics)):
            found[line["topic"].removeprefix("/ledger/drone_a")].append(line["hex"])
        assert found == expected


async def test_each_end_can_be_restarted(tmp_path, master, peer):
    async with Route(tmp_path, master) as route:
        await joined(peer)
        assert await sent(peer, "/fix", range(3)) == await heard(peer, 3)

        # The ledger goes while messages come: they wait.
        await route.stop_ledger()
        late = await sent(peer, "/fix", range(3, 20))
        await route.waiting(17)
        # The sending bridge is killed, with all that waits.
        await route.first.kill()
        await route.start_ledger()
        route.first = await BridgeProcess.start(route.outward)
        assert await heard(peer, 17) == late
        await route.through(20)

        # The receiving bridge is killed, and misses what is committed meanwhile.
        await route.kept()
        await route.second.kill()
        await peer.asked("wait", topic="/fix")
        missed = await sent(peer, "/fix", range(20, 25))
        await route.through(25)
        route.second = await BridgeProcess.start(route.inward)
        assert await heard(peer, 5) == missed

        # The master is another one: bridges make themselves known to it, and so does a new node.
        await master.stop()
        await master.start()
        other = await Peer.start("other", master)
        try:
            await joined(other)
            assert await heard(other, 1) == missed[-1:], "the last message waits for who comes later"
            assert await sent(other, "/fix", range(25, 28)) == await heard(other, 3)
        finally:
            await other.stop()

        # The node is another one at another port.
        again = await Peer.start("again", master)
        try:
            await joined(again)
            await heard(again, 1)
            assert await sent(again, "/fix", range(28, 31)) == await heard(again, 3)
        finally:
            await again.stop()
        assert route.status()["rejected"] == 0


async def test_kills_at_any_moment_lose_nothing_and_write_nothing_twice(tmp_path, master, peer):
    """What the bridge received is on the ledger once, in order, and comes out of the other bridge."""
    sent, done = [], asyncio.Event()

    async def stream():
        for seed in itertools.count():
            sent.append((await peer.asked("fill", topic="/fix", seed=seed))["hex"])
            await asyncio.sleep(0.001)
            if done.is_set():
                return

    async def more(count):
        until = len(sent) + count
        async with asyncio.timeout(20):
            while len(sent) < until:
                await asyncio.sleep(0.005)

    async with Route(tmp_path, master, to_ledger='topic = "/fix"\nbatch_messages = 20') as route:
        await joined(peer)
        streaming = asyncio.create_task(stream())
        for each in ("first", "second", "ledger", "first", "ledger", "second", "first"):
            await more(67)
            if each == "first":
                await route.first.kill()
                route.first = await BridgeProcess.start(route.outward)
            elif each == "second":
                await route.second.kill()
                route.second = await BridgeProcess.start(route.inward)
            else:
                await route.stop_ledger()
                await more(67)
                await route.start_ledger()
        await more(67)
        done.set()
        await streaming
        await route.waiting(0)
        stored = await stored_messages(route.ledger.connection)
        numbers = [each.seq for each in stored]
        assert numbers == sorted(set(numbers))
        places = [sent.index(each.data.hex()) for each in stored]
        assert places == sorted(set(places))
        assert len(places) > 300
        found = []
        while len(set(found)) < len(stored):
            found += await heard(peer, 1)
        assert list(dict.fromkeys(found)) == [each.data.hex() for each in stored], "at least once, in order"


async def stored_messages(where):
    """All messages of all assets, as the blocks have them."""
    found = []
    async with where.open_channel() as channel:
        network = Gateway(channel, where.identity("uav"), where.signer("uav")).network(where.channel)
        contract = AssetContract(network, where.chaincode)
        height = await contract.height()
        async for block in contract.committed(0):
            for event in block.events:
                if event.asset is not None and event.asset.media_type == envelope.MEDIA_TYPE:
                    found += envelope.parse(event.asset.value).messages
            if block.number == height - 1:
                break
    return found


async def test_an_asset_has_its_history_and_can_be_deleted(tmp_path, master, peer):
    async with Route(tmp_path, master) as route:
        await joined(peer)
        for seed in range(3):
            assert await sent(peer, "/fix", [seed]) == await heard(peer, 1)
        config = ["--config", str(route.outward)]
        code, told = await asyncio.to_thread(wonderland, "history", *config, "/fix")
        assert code == 0, told
        changes = json.loads(told)["changes"]
        assert [each["messages"][0]["seq"] for each in changes] == [3, 2, 1]
        assert len(changes[0]["messages"][0]["message"]["position_covariance"]) == 9
        assert changes[0]["owner"] == "uav"
        # Another's bridge cannot delete it.
        code, told = await asyncio.to_thread(wonderland, "delete", "--config", str(route.inward), "ros1/drone-a/fix")
        assert code == 1
        assert "ASSET_OF_OTHER_OWNER" in told
        code, told = await asyncio.to_thread(wonderland, "delete", *config, "/fix")
        assert code == 0, told
        code, told = await asyncio.to_thread(wonderland, "read", *config, "/fix")
        assert (code, "there is no asset ros1/drone-a/fix" in told) == (1, True)
        # The next message makes it anew; its history goes on.
        assert await sent(peer, "/fix", [9]) == await heard(peer, 1)
        code, told = await asyncio.to_thread(wonderland, "history", *config, "/fix")
        assert [each["deleted"] for each in json.loads(told)["changes"]] == [False, True, False, False, False]


async def test_a_program_of_the_robot_gives_orders_and_gets_answers(tmp_path, master, peer):
    """Create, change, read, delete and history by topics alone, as the paper's contract has them."""

    async def ordered(**order):
        text = json.dumps({"request": "7", **order}).encode()
        peer.do("publish", topic="/orders", hex=(len(text).to_bytes(4, "little") + text).hex())
        (answer,) = await heard(peer, 1)
        found = json.loads(bytes.fromhex(answer)[4:])
        assert found.pop("request") in {"7", ""}
        return found

    async with Route(tmp_path, master, more='orders = "/orders"') as route:
        await joined(peer)
        await peer.asked("subscribe", topic="/drone_a/answers", type="std_msgs/String")
        await peer.asked("advertise", topic="/orders", type="std_msgs/String")
        await peer.asked("wait", topic="/orders")
        note = "ros1/drone-a/note"
        assert (await ordered(do="create", asset=note, type="text/note", value="one"))["ok"]
        assert (await ordered(do="update", asset=note, value="two"))["ok"]
        assert (await ordered(do="read", asset=note))["asset"]["value"] == "two"
        assert (await ordered(do="delete", asset=note))["ok"]
        changes = (await ordered(do="history", asset=note))["changes"]
        assert [each["deleted"] for each in changes] == [True, False, False]
        await sent(peer, "/fix", range(1))
        assert len(await heard(peer, 1)) == 1
        assert (await ordered(do="read", asset="/fix"))["asset"]["type"] == FIX
        for order, code in (
            ({"do": "read", "asset": note}, "ASSET_UNKNOWN"),
            ({"do": "create", "asset": "ros1/pad-b/fix", "type": "a/B", "value": ""}, "ASSET_OF_OTHER_BRIDGE"),
            ({"do": "delete", "asset": "ros1/drone-a/nothing"}, "ASSET_UNKNOWN"),
            ({"do": "create", "asset": "ros1/drone-a/x"}, "BAD_ORDER"),
            ({"do": "RetirePad", "asset": "pad-1"}, "BAD_ORDER"),
            ({"do": "read", "asset": "a" * 200}, "BAD_ARGUMENT"),
            ({"do": "read", "asset": "a", "more": 1}, "BAD_ORDER"),
        ):
            answer = await ordered(**order)
            assert (answer["ok"], answer["code"]) == (False, code), answer
        assert route.status()["rejected"] == 0


async def test_what_the_ledger_refuses_is_kept_and_said(tmp_path, master, peer):
    """The asset of this topic is somebody else's already."""
    async with Route(tmp_path, master) as route:
        where = Connection.load(route.ledger_directory / "connection.json")
        async with where.open_channel() as channel:
            gateway = Gateway(channel, where.identity("pad"), where.signer("pad"))
            squatter = AssetContract(gateway.network(where.channel), where.chaincode)
            await squatter.create_asset(
                tx.CreateAsset(id="ros1/drone-a/fix", type="a/B", media_type="text/plain", value="mine")
            )
            await joined(peer)
            messages = await sent(peer, "/fix", range(2))
            await route.through(2)
            assert route.status()["rejected"] >= 1
            command = [sys.executable, "-m", "wonderland.cli", "ros1", "rejected", "--config", str(route.outward)]
            told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
            assert "ASSET_OF_OTHER_OWNER" in told
            assert "they are kept" in route.first.log.read_text()
            # Once its owner has deleted it, they can go.
            await squatter.delete_asset("ros1/drone-a/fix")
            await route.first.stop()
            told = subprocess.run([*command, "--again"], capture_output=True, text=True, check=True).stdout
            assert "2 messages wait again" in told
            route.first = await BridgeProcess.start(route.outward)
            assert await heard(peer, 2) == messages


async def test_events_of_the_whole_contract_are_heard_without_knowing_anything(tmp_path, master, peer):
    chosen = 'senders = ["*"]\nevents = ["*"]\ngive = "events"\ntopic = "/wonderland/{event}"'
    async with Route(tmp_path, master, from_ledger=chosen) as route:
        await peer.asked("subscribe", topic="/wonderland/AssetCreated", type="std_msgs/String")
        await peer.asked("advertise", topic="/fix", type=FIX)
        await peer.asked("wait", topic="/fix")
        await sent(peer, "/fix", range(1))
        events = [json.loads(bytes.fromhex(each)[4:]) for each in await heard(peer, 2)]
        assert [each["record"]["id"].rpartition("/")[2] == "fix" for each in events] == [False, True]
        assert events[1]["record"]["type"] == FIX
        assert "value_sha256" in events[1]["record"]
        assert "value" not in events[1]["record"]
        assert route.ledger is not None


async def test_images_go_by_their_digest_and_too_large_ones_not_at_all(tmp_path, master, peer):
    rules = 'topic = "/camera"\npayload = "digest"\n[[to_ledger]]\ntopic = "/small"\nmax_message_bytes = 1_000_000'
    rules += '\n[[to_ledger]]\ntopic = "/fix"'
    async with Route(tmp_path, master, to_ledger=rules) as route:
        await joined(peer)
        for topic in ("/camera", "/small"):
            await peer.asked("advertise", topic=topic, type="sensor_msgs/Image")
            await peer.asked("wait", topic=topic)
        await peer.asked("image", topic="/small", size=100_000_000)
        digest = (await peer.asked("image", topic="/camera", size=10_000_000))["sha256"]
        assert await sent(peer, "/fix", range(3)) == await heard(peer, 3), "the others go on"
        await route.through(4)
        code, told = await asyncio.to_thread(wonderland, "read", "--config", str(route.outward), "/camera")
        assert code == 0, told
        (message,) = json.loads(told)["messages"]
        assert message["sha256"] == digest
        assert message["size"] > 10_000_000
        refused = "/small is not heard"
        async with asyncio.timeout(20):
            while refused not in (log := route.first.log.read_text()):
                await asyncio.sleep(0.05)
        assert "max_message_bytes allows 1000000" in log


async def test_a_full_spool_holds_the_publisher_up_and_loses_nothing(tmp_path, master, peer):
    """1 MiB of spool and no ledger: rospy keeps the rest, until the ledger is back."""
    async with Route(tmp_path, master, more="max_spool_bytes = 1_048_576") as route:
        await joined(peer)
        await route.stop_ledger()
        expected = await sent(peer, "/fix", range(4_000))
        async with asyncio.timeout(30):
            while (waiting := route.status()["waiting"]) < 2_500:
                await asyncio.sleep(0.05)
        assert waiting < 3_700, "a message takes some 300 bytes"
        await route.start_ledger()
        assert await heard(peer, 4_000) == expected
        await route.through(4_000)


OWN = f"""# A type of nobody's package.
uint8 LANDED=03
float32 STEP=1.50
string WHO=the Hatter # and this belongs to it
Header header
Leg[] legs
float64[36] covariance
geometry_msgs/Point[2] ends
{"=" * 80}
MSG: tea_party/Leg
time begun
duration took
string[] names
bool[3] flags
{"=" * 80}
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
{"=" * 80}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
"""


async def test_two_robots_with_a_master_each_hear_one_another_in_a_type_of_nobodys_package(tmp_path, master, peer):
    """Both ways at once, under the topics' own names, and nothing goes round in circles."""
    other = Master(tmp_path)
    await other.start()
    async with running_ledger(tmp_path / "ledger") as ledger:
        running = [other]
        try:
            body = '[[to_ledger]]\ntopic = "/party/*"\n[[from_ledger]]\nsenders = ["*"]\ntopic = "{topic}"\n'
            for bridge, identity, at in (("drone-a", "uav", master), ("pad-b", "pad", other)):
                file = tmp_path / "ledger" / "connection.json"
                path = tmp_path / f"{bridge}.toml"
                write_config(path, ledger=file, master=at.uri, identity=identity, bridge=bridge, body=body)
                running.append(await BridgeProcess.start(path))
            there = await Peer.start("there", other)
            running.append(there)
            kind = {"type": "tea_party/State", "definition": OWN}
            for one, another, topic in ((peer, there, "/party/a"), (there, peer, "/party/b")):
                await another.asked("subscribe", topic=topic, **kind)
                await one.asked("advertise", topic=topic, **kind)
            for one, another, topic in ((peer, there, "/party/a"), (there, peer, "/party/b")):
                await one.asked("wait", topic=topic)
                for seeds in (range(5), range(5, 10)):
                    assert await sent(one, topic, seeds) == await heard(another, 5)
            stored = await stored_messages(ledger.connection)
            assert len(stored) == 20, "each message once, whoever heard it"
        finally:
            for each in reversed(running):
                await each.stop()
