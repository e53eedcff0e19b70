"""The half towards the ledger, without one: what is sent once, what is kept, what is left out."""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import signal
import subprocess
import sys
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wonderland.asset_contract import CommittedBlock, CommittedEvent
from wonderland.proof_contract import AwayError, Committed, RefusedError
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.assets import Asset
from wonderland.toml_settings import SettingsError
from wonderland_ros_bridge.errors import EnvelopeError, SpoolError
from wonderland_ros_bridge.intake import Intake, Kind
from wonderland_ros_bridge.ledger import envelope, sender
from wonderland_ros_bridge.ledger.envelope import Batch, Message
from wonderland_ros_bridge.ledger.listener import Choice, Listener
from wonderland_ros_bridge.ledger.orders import Orders
from wonderland_ros_bridge.ledger.outbox import Outbox, Received
from wonderland_ros_bridge.ledger.policy import Rule, Sampler
from wonderland_ros_bridge.ledger.sender import Sender
from wonderland_ros_bridge.ros1 import definitions
from wonderland_ros_bridge.settings import load

MD5 = "0" * 32


def received(seq, topic="/fix", data=b"x", kind="a/B"):
    return Received(topic, "ros1", kind, MD5, Message(seq=seq, t_ms=seq, data=data))


def batch(number=1, seqs=(1,), *, bridge="drone-a", epoch="0" * 16, topic="/fix", kind="a/B"):
    messages = tuple(Message(seq=seq, t_ms=seq, data=b"x") for seq in seqs)
    return Batch(bridge, epoch, number, topic, "ros1", kind, MD5, messages)


def kind_of(name, text):
    made = definitions.parse(name, text)
    return Kind("ros1", name, made.md5, text, definitions.codec(name, text).decode)


@pytest.fixture
def outbox(tmp_path):
    made = Outbox(tmp_path / "spool", bridge="drone-a")
    yield made
    made.close()


class Ledger:
    """Assets in memory, with the contract's own rules, and answers that can be lost."""

    def __init__(self):
        self.assets = {}
        self.writes = []
        self.lost_answers = 0
        self.refusal = None

    async def create_asset(self, argument):
        if argument.id in self.assets:
            raise RefusedError(409, "ASSET_EXISTS", "exists")
        return await self._write(argument)

    async def update_asset(self, argument):
        if argument.id not in self.assets:
            raise RefusedError(404, "ASSET_UNKNOWN", "there is none")
        return await self._write(argument)

    async def read_asset(self, asset_id):
        return self.assets.get(asset_id)

    async def _write(self, argument):
        await asyncio.sleep(0)
        if self.refusal is not None:
            raise self.refusal
        self.assets[argument.id] = Asset(
            id=argument.id, type=argument.type, media_type=argument.media_type, value=argument.value,
            owner_msp="UavMSP", owner="uav", version=1, created_ms=0, updated_ms=0,
        )  # fmt: skip
        if argument.media_type == envelope.MEDIA_TYPE:
            self.writes.append((argument.id, [each.seq for each in envelope.parse(argument.value).messages]))
        if self.lost_answers:
            self.lost_answers -= 1
            raise AwayError("the answer was lost", "f" * 64)
        return Committed("f" * 64, len(self.writes))


async def send_all(outbox, ledger, rule=None, *, until=lambda: False):
    """Send until nothing waits, or until something else is so."""
    rule = rule or Rule(topic="/fix")
    working = Sender(outbox, ledger, prefix="ros1", rule_of=lambda _: rule, clock=lambda: 0)
    task = asyncio.create_task(working.run())
    async with asyncio.timeout(20):
        while outbox.pending() and not until() and not task.done():
            await asyncio.sleep(0.005)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    return working


async def test_an_answer_that_was_lost_writes_nothing_twice(outbox, monkeypatch):
    monkeypatch.setattr(sender, "FIRST_PAUSE_S", 0.001)
    for keep in ("latest", "each"):
        ledger = Ledger()
        ledger.lost_answers = 2
        outbox.put([received(seq) for seq in range(1, 8)], {"/fix": 7}, [])
        await send_all(outbox, ledger, Rule(topic="/fix", keep=keep, batch_messages=3))
        assert [seqs for _, seqs in ledger.writes] == [[1, 2, 3], [4, 5, 6], [7]]
        assert len({name for name, _ in ledger.writes}) == (1 if keep == "latest" else 3)


async def test_a_batch_that_was_sent_before_a_kill_is_not_sent_again(tmp_path):
    ledger = Ledger()
    first = Outbox(tmp_path / "spool", bridge="drone-a")
    first.put([received(1), received(2)], {"/fix": 2}, [])
    found, before = first.next_batch("/fix", max_messages=10, max_characters=10_000)
    assert not before
    await ledger._write(_update(found))  # and now the power goes
    first.close()
    second = Outbox(tmp_path / "spool", bridge="drone-a")
    second.put([received(3)], {"/fix": 3}, [])
    await send_all(second, ledger)
    assert [seqs for _, seqs in ledger.writes] == [[1, 2], [3]]
    second.close()


async def test_a_batch_that_was_not_sent_before_a_kill_is_sent_though_an_earlier_one_is_there(tmp_path):
    ledger = Ledger()
    first = Outbox(tmp_path / "spool", bridge="drone-a")
    first.put([received(1)], {"/fix": 1}, [])
    await send_all(first, ledger)
    first.put([received(2)], {"/fix": 2}, [])
    first.next_batch("/fix", max_messages=10, max_characters=10_000)  # and now the power goes
    first.close()
    second = Outbox(tmp_path / "spool", bridge="drone-a")
    await send_all(second, ledger)
    assert [seqs for _, seqs in ledger.writes] == [[1], [2]]
    second.close()


def _update(found):
    return tx.UpdateAsset(
        id=envelope.topic_asset_id("ros1", "drone-a", found.topic),
        value=found.value(),
        type=found.type,
        media_type=envelope.MEDIA_TYPE,
    )


@pytest.mark.parametrize(
    ("refusal", "kept"),
    [
        (RefusedError(403, "ASSET_OF_OTHER_OWNER", "ask them"), True),
        (RefusedError(400, "ASSET_TOO_LARGE", "too large"), True),
        (RefusedError(403, "ROLE_MISSING", "enrol again"), False),
        (RefusedError(0, "MVCC_READ_CONFLICT", "again"), False),
        (RefusedError(0, "PERMISSION_DENIED", "revoked"), False),
        (RefusedError(500, "STATE_UNREADABLE", "upgrade"), False),
    ],
)
async def test_what_is_refused_is_kept_with_its_reason_or_waits(outbox, refusal, kept):
    ledger = Ledger()
    ledger.refusal = refusal
    outbox.put([received(1)], {"/fix": 1}, [])
    tried = []
    ledger.read_asset = lambda name: _none(tried.append(name))
    await send_all(outbox, ledger, until=lambda: len(tried) >= 2)
    assert outbox.pending() == (0 if kept else 1)
    assert outbox.send_again() == (1 if kept else 0)
    ledger.refusal = None
    del ledger.read_asset
    await send_all(outbox, ledger)
    assert [seqs for _, seqs in ledger.writes] == [[1]], "nothing is lost"


async def _none(_):
    return None


async def test_batches_hold_one_type_and_fit_into_an_asset(outbox):
    outbox.put([received(1), received(2, kind="a/C"), received(3, kind="a/C")], {"/fix": 3}, [])
    outbox.put([received(seq, data=b"z" * 60_000, kind="a/C") for seq in range(4, 10)], {"/fix": 9}, [])
    ledger = Ledger()
    await send_all(outbox, ledger, Rule(topic="/fix", batch_bytes=128 * 1024))
    assert [seqs for _, seqs in ledger.writes] == [[1], [2, 3, 4, 5], [6, 7], [8, 9]]
    assert outbox.pending_bytes == 0


async def test_a_definition_goes_before_its_first_message_and_once(outbox):
    ledger = Ledger()
    outbox.put([received(1)], {"/fix": 1}, [("a/B", MD5, "int8 x\n")])
    await send_all(outbox, ledger)
    outbox.put([received(2)], {"/fix": 2}, [("a/B", MD5, "int8 x\n")])
    await send_all(outbox, ledger)
    assert list(ledger.assets) == [f"ros1/drone-a/definition/a/B/{MD5}", "ros1/drone-a/fix"]


def test_an_outbox_survives_a_kill_at_any_moment(tmp_path):
    program = f"""
import sys
from wonderland_ros_bridge.ledger.outbox import Outbox, Received
from wonderland_ros_bridge.ledger.envelope import Message
box = Outbox(__import__("pathlib").Path({str(tmp_path / "spool")!r}), bridge="drone-a")
for seq in range(1, 100_000):
    box.put([Received("/fix", "ros1", "a/B", "0" * 32, Message(seq=seq, t_ms=0, data=b"x"))], {{"/fix": seq}}, [])
    if seq % 3 == 0:
        found, _ = box.next_batch("/fix", max_messages=2, max_characters=1_000)
        box.settle(found)
        print(seq, found.messages[-1].seq, flush=True)
"""
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    for _ in range(20):
        line = process.stdout.readline()
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    rest = process.stdout.read().splitlines()
    process.stdout.close()
    put, settled = map(int, ([line, *rest][-1]).split())
    box = Outbox(tmp_path / "spool", bridge="drone-a")
    assert box.received("/fix") >= put
    found, _ = box.next_batch("/fix", max_messages=1_000, max_characters=1 << 30)
    assert found.messages[0].seq <= settled + 3
    assert [each.seq for each in found.messages] == list(
        range(found.messages[0].seq, found.messages[0].seq + len(found.messages))
    )
    assert found.batch > settled // 2
    box.close()


def test_a_spool_is_one_bridges(tmp_path, outbox):
    with pytest.raises(SpoolError, match="another bridge uses this spool"):
        Outbox(tmp_path / "spool", bridge="drone-a")
    other = Outbox(tmp_path / "other", bridge="drone-b")
    assert other.epoch != outbox.epoch, "numbers of a lost spool are not met again"
    other.close()
    with pytest.raises(SpoolError, match="belongs to bridge 'drone-b'"):
        Outbox(tmp_path / "other", bridge="drone-a")
    (tmp_path / "text").write_text("no database" * 100)
    with pytest.raises(SpoolError, match="not a database"):
        Outbox(tmp_path / "text", bridge="drone-a")
    with pytest.raises(SpoolError, match="does its directory exist"):
        Outbox(tmp_path / "nowhere" / "spool", bridge="drone-a")


@given(st.lists(st.binary(max_size=40), min_size=1, max_size=5), st.integers(1, 2**53 - 1))
def test_messages_come_out_of_an_asset_as_they_went_in(messages, number):
    made = Batch(
        "b", "0" * 16, number, "/t", "ros1", "a/B", MD5,
        tuple(Message(seq=seq, t_ms=seq, data=data) for seq, data in enumerate(messages)),
    )  # fmt: skip
    assert envelope.parse(made.value()) == made
    assert len(made.value()) <= 400 + sum(map(envelope.characters, made.messages))


@pytest.mark.parametrize(
    "value",
    ["", "{}", "[1]", "null", '{"format":2}', "[" * 100_000, "x" * 600_000, batch().value().replace('"a/B"', '"a b"'),
     batch().value().replace('"eA=="', '"?"'), batch().value().replace('"data":"eA=="', '"size":1')],
    ids=["empty", "no fields", "list", "null", "format", "deep", "long", "type", "base64", "neither"],
)  # fmt: skip
def test_a_value_that_is_no_batch_is_refused(value):
    with pytest.raises(EnvelopeError):
        envelope.parse(value)


def test_ids_of_long_names_are_bounded_and_differ():
    names = [f"/{'x' * 200}{number}" for number in range(3)]
    ids = {envelope.topic_asset_id("ros1", "b" * 40, name) for name in names}
    ids |= {envelope.batch_asset_id("ros1", batch(topic=name, bridge="b" * 40)) for name in names}
    assert len(ids) == 6
    assert all(len(each) <= envelope.MAX_ID for each in ids)


def test_a_sample_is_of_the_rate_that_was_asked_for():
    sampler = Sampler(Rule(topic="/t", max_hz=10))
    taken = [t_ms for t_ms in range(1_000, 11_000, 7) if sampler.takes(t_ms)]
    assert 99 <= len(taken) <= 101
    same = Sampler(Rule(topic="/t", max_hz=10))
    jitter = [1_000 + 100 * each + (7 if each % 2 else -7) for each in range(100)]
    assert sum(map(same.takes, jitter)) == 100, "a topic of that very rate loses nothing to jitter"
    every = Sampler(Rule(topic="/t", every=5))
    assert [every.takes(0) for _ in range(10)] == [True, *[False] * 4] * 2


def test_large_messages_and_topics_by_digest_have_their_sha_256():
    small, large = b"s" * 64 * 1024, b"l" * (64 * 1024 + 1)
    whole = Sampler(Rule(topic="/t"))
    assert whole.message(1, 2, small).data == small
    assert whole.message(1, 2, large) == Message(
        seq=1, t_ms=2, sha256=hashlib.sha256(large).hexdigest(), size=len(large)
    )
    assert Sampler(Rule(topic="/t", payload="digest")).message(1, 2, b"a").data is None


def test_a_pattern_takes_no_topic_of_a_bridge():
    everything = Rule(topic="/*")
    assert everything.fits("/fix")
    assert not everything.fits("/ledger/drone_a/fix")
    assert not everything.fits("/rosout")
    assert Rule(topic="/ledger/*").fits("/ledger/drone_a/fix")


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("", "nothing to do"),
        ('[[to_ledger]]\ntopic = "fix"', "to_ledger"),
        ('[[to_ledger]]\ntopic = "/fix"\nevery = 0', "every"),
        ('[[to_ledger]]\ntopic = "/fix"\nevry = 1', "evry is unknown"),
        ('[[to_ledger]]\ntopic = "/fix"\npayload = "digest"\ninline_bytes = 1', "inline_bytes does not go"),
        ('[[from_ledger]]\ntopic = "/x"', "senders is missing"),
        ("[[from_ledger]]\nsenders = []", "senders"),
        ('[[to_ledger]]\ntopic = "/fix"\n[ros1]\nnetworks = ["here"]', "is no network"),
        ('[[to_ledger]]\ntopic = "/fix"\n[ros1]\nmaster = "file:///etc"', "master"),
    ],
)
def test_settings_that_cannot_be_worked_with_name_the_field(tmp_path, body, says):
    path = tmp_path / "ros1.toml"
    path.write_text(f'bridge = "a"\nspool = "s"\n{body}\n[ledger]\nconnection = "c"\nidentity = "i"\n')
    with pytest.raises(SettingsError, match=says):
        load(path)


class Published:
    """A wire that remembers."""

    def __init__(self):
        self.batches = []
        self.texts = []

    async def publish_batch(self, topic, found, definition, *, latch):
        self.batches.append((topic, [each.seq for each in found.messages]))

    async def publish_text(self, topic, text, *, latch):
        self.texts.append((topic, json.loads(text)))


def event_of(found, *, sender="UavMSP/uav", name="AssetUpdated", kind=None):
    asset = Asset(
        id="ros1/drone-a/fix", type=kind or found.type, media_type=envelope.MEDIA_TYPE, value=found.value(),
        owner_msp="UavMSP", owner="uav", version=1, created_ms=0, updated_ms=0,
    )  # fmt: skip
    return CommittedEvent(name, "f" * 64, 0, sender, {"id": asset.id, "type": asset.type}, asset)


async def hear(outbox, choice, *blocks):
    """What is published of these blocks."""
    wire = Published()

    class Chain:
        async def height(self):
            return 0

        async def committed(self, start_block):
            for number, events in enumerate(blocks):
                if number >= start_block:
                    yield CommittedBlock(number, tuple(events))
            done.set()
            await asyncio.Event().wait()

        async def read_asset(self, _):
            return None

    done = asyncio.Event()
    task = asyncio.create_task(Listener(Chain(), outbox, wire, [choice], prefix="ros1").run())
    await asyncio.wait_for(done.wait(), 10)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    return wire


ALL = Choice(senders=("*",))


async def test_a_batch_is_handed_out_once_whatever_way_it_comes(outbox):
    theirs = [batch(1, (1, 2), bridge="b"), batch(2, (3,), bridge="b"), batch(2, (3,), bridge="b")]
    blocks = [[event_of(theirs[0])], [event_of(theirs[1]), event_of(theirs[2])]]
    assert (await hear(outbox, ALL, *blocks)).batches == [("/ledger/b/fix", [1, 2]), ("/ledger/b/fix", [3])]
    # After a restart, from the place that was kept; and a copy of an old batch in a later block.
    later = [*blocks, [event_of(theirs[0]), event_of(batch(3, (4,), bridge="b"))]]
    assert (await hear(outbox, ALL, *later)).batches == [("/ledger/b/fix", [4])]


async def test_who_is_not_named_is_not_heard(outbox):
    theirs = batch(1, bridge="b")
    only = Choice(senders=("PadMSP/*",))
    assert not (await hear(outbox, only, [event_of(theirs)])).batches
    types = Choice(senders=("*",), types=("geometry_msgs/*",))
    assert not (await hear(outbox, types, [], [event_of(theirs)])).batches


async def test_what_lies_about_itself_or_is_ones_own_is_not_published(outbox):
    own = Batch("drone-a", outbox.epoch, 1, "/fix", "ros1", "a/B", MD5, batch().messages)
    lie = event_of(batch(1, bridge="b"), kind="a/C")
    assert not (await hear(outbox, ALL, [event_of(own), lie])).batches


async def test_what_was_taken_is_on_the_disk_when_a_bridge_is_told_to_stop(outbox):
    working = Sender(outbox, Ledger(), prefix="ros1", rule_of=lambda _: Rule(topic="/t"), clock=lambda: 0)
    intake = Intake(outbox, working, lambda: 0, steady=lambda: 0, max_bytes=1 << 30)
    await intake.begin("/t", Rule(topic="/t"))
    running = asyncio.create_task(intake.run())
    string = kind_of("std_msgs/String", "string data\n")
    for number in range(50):
        await intake.take("/t", string, b"\x01\x00\x00\x00x", "http://127.0.0.1:1/")
        if number % 7 == 0:
            await asyncio.sleep(0)
    await intake.take("/t", string, b"\x09\x00\x00\x00x", "http://127.0.0.1:1/")
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    await intake.flush()
    assert await outbox.run(outbox.pending) == 50
    assert await outbox.run(outbox.received, "/t") == 51, "bytes that are no message have a number, and are left out"
    assert intake.refused == 1


async def test_a_definition_that_somebody_else_has_put_there_is_said(outbox, caplog):
    ledger = Ledger()
    squatted = tx.CreateAsset(
        id=f"ros1/drone-a/definition/a/B/{MD5}", type="a/B", media_type="text/plain", value="int8 y\n"
    )
    await ledger.create_asset(squatted)
    outbox.put([received(1)], {"/fix": 1}, [("a/B", MD5, "int8 x\n")])
    await send_all(outbox, ledger)
    assert [seqs for _, seqs in ledger.writes] == [[1]], "messages go all the same"
    assert "call this bridge by another name" in caplog.text


async def test_what_waits_for_a_slow_disk_is_not_taken_back_by_a_stop(outbox):
    working = Sender(outbox, Ledger(), prefix="ros1", rule_of=lambda _: Rule(topic="/t"), clock=lambda: 0)
    intake = Intake(outbox, working, lambda: 0, steady=lambda: 0, max_bytes=1 << 30)
    await intake.begin("/t", Rule(topic="/t"))
    disk = threading.Event()
    slow = asyncio.create_task(outbox.run(disk.wait, 20))
    running = asyncio.create_task(intake.run())
    string = kind_of("std_msgs/String", "string data\n")
    await intake.take("/t", string, b"\x01\x00\x00\x00x", "http://127.0.0.1:1/")
    while intake._queue:
        await asyncio.sleep(0)
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    disk.set()
    await slow
    assert await outbox.run(outbox.pending) == 1


@pytest.mark.parametrize(
    ("order", "code"),
    [
        ({"do": "create", "asset": "pad-1", "type": "a/B", "value": ""}, "ASSET_OF_OTHER_BRIDGE"),
        ({"do": "delete", "asset": "ros1/drone-ab/fix"}, "ASSET_OF_OTHER_BRIDGE"),
        ({"do": "update", "asset": "ros1/drone-a/x", "value": "v"}, "ASSET_UNKNOWN"),
        ({"do": "create", "asset": "ros1/drone-a/x"}, "BAD_ORDER"),
        ({"do": "create", "asset": "ros1/drone-a/x", "type": "a b", "value": ""}, "BAD_ORDER"),
        ({"do": "read", "asset": ""}, "BAD_ORDER"),
        ({"do": "read", "asset": "/fix"}, "ASSET_UNKNOWN"),
        ({"do": "history", "asset": "/fix", "limit": 0}, "BAD_ORDER"),
        ([], "BAD_ORDER"),
    ],
)
async def test_orders_stay_within_the_bridges_own_assets(order, code):
    ledger = Ledger()
    answer = json.loads(await Orders(ledger, prefix="ros1", bridge="drone-a").carry_out(json.dumps(order).encode()))
    assert (answer["ok"], answer["code"]) == (False, code)
    assert not ledger.assets


@pytest.mark.parametrize("text", [b"", b"\xff", b"[" * 100_000, b'{"do":"read"}'])
async def test_a_text_that_is_no_order_is_answered(text):
    answer = json.loads(await Orders(Ledger(), prefix="ros1", bridge="drone-a").carry_out(text))
    assert (answer["ok"], answer["code"], answer["request"]) == (False, "BAD_ORDER", "")
