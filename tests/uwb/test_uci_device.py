"""The host's state machine against a virtual node, without ports and with time that the test moves."""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.uwb.layout import RangingPlan
from wonderland_fira_uci.uci.config import ParameterId, SessionConfig
from wonderland_fira_uci.uci.data import DataTransferStatus
from wonderland_fira_uci.uci.device import UciDevice
from wonderland_fira_uci.uci.device_events import (
    CreditGranted,
    DeviceLost,
    DeviceReady,
    SessionChanged,
    SessionEnded,
    SessionLost,
    SessionMessage,
    StreamResynchronised,
)
from wonderland_fira_uci.uci.errors import UciConfigRejectedError, UciStateError, UciStatusError
from wonderland_fira_uci.uci.packets import MessageType, encode_control
from wonderland_fira_uci.uci.ranging import RangeData
from wonderland_fira_uci.uci.session import Command, get_state_command, init_command, reset_command, start_command
from wonderland_fira_uci.uci.status import SessionState, Status
from wonderland_simulator.uci_node import IDEAL, Quirks, VirtualNode

PLAN = RangingPlan(session_a_id=1, session_b_id=2, pad_macs=(0xA001,), uav_mac=0xD001, sts_key=bytes(16))
WORDS = dataclasses.replace(PLAN.pad_ranging(0), session_id=2)


class NoAir:
    """Rounds are what a test writes."""

    def join(self, session: object) -> None: ...
    def leave(self, session: object) -> None: ...


class Bench:
    def __init__(self, quirks: Quirks | None = None) -> None:
        self.ms = 10_000
        self.machine = UciDevice()
        self.node = VirtualNode("node", NoAir(), profile=IDEAL, quirks=quirks)  # type: ignore[arg-type]
        self.node.transmit = self._from_node
        self.to_host: list[bytes] = []
        self.log: list[str] = []
        self.events: list[Any] = []
        self.filter: Callable[[bytes], bytes] = lambda packet: packet
        self.deaf = False

    def _from_node(self, data: bytes) -> None:
        passed = self.filter(data)
        if passed:
            self.log.append("< " + passed.hex())
            self.to_host.append(passed)

    def settle(self) -> None:
        for _ in range(200):
            out = self.machine.data_to_send()
            self.events += self.machine.events()
            if not out and not self.to_host:
                return
            if out:
                self.log.append("> " + out.hex())
                if not self.deaf:
                    self.node.receive(out)
            waiting, self.to_host = self.to_host, []
            for data in waiting:
                self.machine.receive_data(data, self.ms)
        pytest.fail("host and node talk without end")

    def run(self, ms: int) -> None:
        end = self.ms + ms
        self.settle()
        while True:
            due = self.machine.next_timeout_ms()
            if due is None or due > end:
                break
            self.ms = max(due, self.ms + 1)
            self.machine.advance(self.ms)
            self.settle()
        self.ms = end

    def boot(self) -> None:
        self.machine.port_up(self.ms)
        self.settle()

    def open(self, config: SessionConfig) -> None:
        self.machine.open_session(config, self.ms)
        self.settle()

    def take(self, kind: type) -> list[Any]:
        out = [e for e in self.events if isinstance(e, kind)]
        self.events = [e for e in self.events if not isinstance(e, kind)]
        return out

    def state(self, session_id: int = 1) -> SessionState | None:
        session = self.machine._sessions.get(session_id)
        return session.state if session else None


def opened(quirks: Quirks | None = None) -> Bench:
    bench = Bench(quirks)
    bench.boot()
    bench.open(PLAN.pad_ranging(0))
    bench.run(2_000)
    assert bench.state() is SessionState.ACTIVE
    return bench


def test_the_conversation_is_the_one_that_nodes_expect() -> None:
    bench = Bench()
    bench.boot()
    assert bench.log[:6] == [
        "> 2000000100",
        "< 4000000100",
        "< 6001000101",
        "> 20020000",
        "< 4002000a000200020002000100" + "00",
        "> 20030000",
    ]
    assert len(bench.take(DeviceReady)) == 1
    del bench.log[:]
    bench.open(PLAN.pad_ranging(0))
    config = PLAN.pad_ranging(0).app.encode().hex()
    assert bench.log == [
        "> 210000050100000001",
        "< 4100000100",
        "< 61020006010000000000",
        f"> 210300{4 + len(config) // 2:02x}01000000{config}",
        "< 410300020000",
        "< 61020006010000000300",
        "> 2200000401000000",
        "< 4200000100",
        "< 61020006010000000200",
        "< 6001000102",
    ]
    del bench.log[:]
    bench.machine.close_session(1, bench.ms)
    bench.settle()
    assert bench.log == [
        "> 2201000401000000",
        "< 4201000100",
        "< 61020006010000000300",
        "< 6001000101",
        "> 2101000401000000",
        "< 4101000100",
        "< 61020006010000000100",
    ]
    [ended] = bench.take(SessionEnded)
    assert ended == SessionEnded(1, None)
    states = [e.change.state for e in bench.take(SessionChanged)]
    assert states == [
        SessionState.INIT,
        SessionState.IDLE,
        SessionState.ACTIVE,
        SessionState.IDLE,
        None,
    ]


def test_the_nodes_errors_are_those_of_real_ones() -> None:
    bench = Bench()

    def ask(hex_command: str) -> list[str]:
        del bench.log[:]
        bench.node.receive(bytes.fromhex(hex_command))
        return [line[2:] for line in bench.log]

    assert ask("20020000") == ["60010001ff"]  # nothing before a reset
    assert ask("2000000100") == ["4000000100", "6001000101"]
    assert ask("2200000401000000") == ["4200000111"]
    assert ask("2101000401000000") == ["4101000111"]
    assert ask("24000000") == ["4400000107"]
    assert ask("20090000") == ["400900020103"]
    assert ask("210000020100") == ["410000020103"]
    assert ask("210000050100000001")[0] == "4100000100"
    assert ask("210000050100000001") == ["4100000112"]
    assert ask("2106000401000000") == ["4106000111"]  # the refused duplicate has taken the old one away
    assert ask("210000050100000000")[0] == "4100000100"
    assert ask("2200000401000000") == ["4200000115"]
    assert ask("21030006010000000204") == ["410300020103"]
    assert ask("210300080100000001040109") == ["410300020000", "61020006010000000300"]
    assert ask("2200000401000000") == ["4200000115"]  # some parameters are not enough, and only START says so
    good = PLAN.pad_ranging(0).app.parameters()
    bad = [(i, b"\x09\x09") if i == ParameterId.CHANNEL_NUMBER else (i, v) for i, v in good]
    config = Command(1, 3, (1).to_bytes(4, "little") + _encode(bad)).encode().hex()
    assert ask(config) == ["4103000404010404"]
    unknown = Command(1, 3, (1).to_bytes(4, "little") + _encode([*good, (0xE9, b"\x00")])).encode().hex()
    assert ask(unknown) == ["410300020103"]
    late_mode = [p for p in good if p[0] != ParameterId.MAC_ADDRESS_MODE] + [(0x26, b"\x00")]
    assert ask(Command(1, 3, (1).to_bytes(4, "little") + _encode(late_mode)).encode().hex()) == ["4103000404010604"]
    assert ask(Command(1, 3, (1).to_bytes(4, "little") + _encode(good)).encode().hex())[0] == "410300020000"
    assert ask("2201000401000000") == ["4201000113"]
    assert ask("2200000401000000")[0] == "4200000100"
    assert ask("2200000401000000") == ["4200000115"]
    assert ask(Command(1, 3, (1).to_bytes(4, "little") + _encode(good)).encode().hex()) == ["4103000113"]
    assert ask("2106000401000000") == ["410600020002"]
    assert ask("2105000" + "0") == ["410500020001"]
    assert ask("210400060100000001" + "45") == ["4104001400014510" + bytes(16).hex()]  # the key can be read back
    assert ask("2107000c01000000" + "0001" + "02a0" + "00000000") == ["4107000101"]  # not for controlees
    assert ask("01001100" + "01000000" + "01d0000000000000" + "0700" + "0100" + "aa") == [
        "62050007" + "01000000" + "07" + "05" + "01"  # a ranging-only session
    ]
    assert ask("2101000401000000") == ["4101000100", "61020006010000000100", "6001000101"]


def _encode(parameters: list[tuple[int, bytes]]) -> bytes:
    return bytes((len(parameters),)) + b"".join(bytes((i, len(v))) + v for i, v in parameters)


def test_a_controller_may_change_its_list_of_controlees() -> None:
    bench = opened()
    bench.machine.close_session(1, bench.ms)
    bench.settle()
    bench.open(PLAN.uav_ranging())
    answers = []
    for action, mac in ((0, 0xA001), (1, 0xA009), (0, 0xA002), (1, 0xA001), (1, 0xA002)):
        del bench.log[:]
        entry = mac.to_bytes(2, "little") + bytes(4)
        bench.node.receive(Command(1, 7, (1).to_bytes(4, "little") + bytes((action, 1)) + entry).encode())
        answers.append(bench.log[0][2:])
    assert answers == ["410700020208", "410700020207", "4107000100", "4107000100", "4107000102"]


def test_a_lost_state_notification_is_asked_for() -> None:
    bench = Bench()
    bench.filter = lambda packet: b"" if packet[:2] == b"\x61\x02" else packet
    bench.boot()
    bench.open(PLAN.pad_ranging(0))
    assert bench.state() is None
    bench.run(3_000)
    assert bench.state() is SessionState.ACTIVE
    assert any(line == "> " + get_state_command(1).encode().hex() for line in bench.log)


def test_an_unanswered_command_resets_the_node_and_every_session_comes_back() -> None:
    bench = opened()
    bench.open(WORDS)
    assert bench.state(2) is SessionState.ACTIVE
    del bench.log[:]
    bench.deaf = True
    bench.run(2_050)  # silence on the air, then silence to the question
    assert not bench.take(DeviceLost)
    bench.run(900)
    assert "was not answered within" in bench.take(DeviceLost)[0].detail
    assert {e.session_id for e in bench.take(SessionLost)} == {1, 2}
    bench.deaf = False
    bench.run(5_000)
    assert bench.state(1) is bench.state(2) is SessionState.ACTIVE


def test_pauses_between_resets_grow_to_their_limit() -> None:
    bench = Bench()
    bench.deaf = True
    bench.boot()
    bench.run(60_000)
    resets = [line for line in bench.log if line == "> " + reset_command().encode().hex()]
    assert 12 <= len(resets) <= 18
    bench.deaf = False
    bench.run(6_000)
    assert bench.take(DeviceReady)


def test_a_node_that_hangs_at_rest_is_noticed_within_seconds_and_comes_back() -> None:
    bench = Bench()
    bench.boot()
    bench.run(60_000)
    assert not bench.take(DeviceLost)
    bench.deaf = True
    bench.run(2_400)
    (lost,) = bench.take(DeviceLost)
    assert "CORE_GET_DEVICE_INFO was not answered" in lost.detail
    bench.deaf = False
    bench.take(DeviceReady)
    bench.run(2_000)
    assert bench.take(DeviceReady)


def test_a_device_error_and_a_vanished_port_lose_everything() -> None:
    bench = opened()
    bench._from_node(bytes.fromhex("60010001ff"))
    bench.settle()
    assert "device error" in bench.take(DeviceLost)[0].detail
    bench.run(1_000)
    assert bench.state() is SessionState.ACTIVE
    bench.machine.port_down("unplugged")
    bench.settle()
    assert bench.take(DeviceLost) == [DeviceLost("unplugged")]
    assert bench.machine.next_timeout_ms() is None
    bench.machine.close_session(1, bench.ms)
    bench.settle()
    assert bench.take(SessionEnded) == [SessionEnded(1, None)]


def test_a_late_idle_is_not_believed_and_a_stop_of_the_nodes_own_is_mended() -> None:
    bench = opened()
    bench._from_node(bytes.fromhex("61020006010000000300"))
    bench.settle()
    assert bench.state() is SessionState.ACTIVE
    assert bench.log[-1] == "< 410600020002"
    session = bench.node.sessions[1]
    bench.node._stop(session)
    bench._from_node(bytes.fromhex("61020006010000000381"))
    bench.settle()
    assert bench.state() is SessionState.ACTIVE
    assert SessionChanged(1, bench.take(SessionChanged)[-2].change).change.reason == 0x81


def test_refusals_end_the_session_with_what_the_node_said() -> None:
    config = PLAN.pad_ranging(0)
    cases: list[tuple[bytes, bytes, type[UciStatusError], str]] = [
        (b"\x41\x00", bytes.fromhex("4100000114"), UciStatusError, "SESSION_INIT.*MAX_SESSIONS"),
        (b"\x41\x03", bytes.fromhex("4103000404010804"), UciConfigRejectedError, "SLOT_DURATION"),
        (b"\x41\x03", bytes.fromhex("410300020103"), UciConfigRejectedError, "no parameter"),
        (b"\x42\x00", bytes.fromhex("4200000115"), UciStatusError, "SESSION_START.*NOT_CONFIGURED"),
        (b"\x42\x00", bytes.fromhex("4200000102"), UciStatusError, "FAILED"),
    ]
    for prefix, answer, kind, text in cases:
        bench = Bench()
        bench.boot()

        def replace(packet: bytes, prefix: bytes = prefix, answer: bytes = answer) -> bytes:
            if packet[:2] == prefix:
                return answer
            return b"" if packet[:2] == b"\x61\x02" and packet[8] == 2 else packet

        bench.filter = replace
        if prefix == b"\x42\x00":
            bench.node.air.join = lambda session: setattr(session, "state", SessionState.IDLE)  # type: ignore[method-assign]
        bench.open(config)
        bench.filter = lambda packet: packet
        bench.run(5_000)
        [ended] = bench.take(SessionEnded)
        assert isinstance(ended.error, kind)
        with pytest.raises(kind, match=text):
            raise ended.error
        assert bench.node.sessions == {} or prefix == b"\x41\x00"
        bench.open(WORDS)
        bench.run(3_000)
        assert bench.state(2) is SessionState.ACTIVE or prefix == b"\x42\x00"


def test_a_generic_error_answers_the_command_and_a_retry_is_repeated() -> None:
    bench = Bench()
    bench.boot()
    del bench.log[:]
    refused = iter((b"\x60\x07\x00\x01\x0a", b"\x41\x00\x00\x01\x0a"))

    def once(packet: bytes) -> bytes:
        return next(refused, packet) if packet[:2] == b"\x41\x00" else packet

    bench.filter = once
    bench.node._init = _forgetful(bench.node._init, bench.node)  # type: ignore[method-assign]
    bench.open(PLAN.pad_ranging(0))
    assert bench.log.count("> " + init_command(1, 1).encode().hex()) == 3
    assert bench.state() is SessionState.ACTIVE
    bench.filter = lambda packet: b"\x60\x07\x00\x01\x02" if packet[:2] == b"\x41\x00" else packet
    bench.open(WORDS)
    bench.run(2_000)
    assert "FAILED" in str(next(e for e in bench.take(SessionEnded) if e.session_id == 2).error)


def _forgetful(init: Callable[[Command], None], node: VirtualNode) -> Callable[[Command], None]:
    def forget_first(command: Command) -> None:
        node.sessions.clear()
        init(command)

    return forget_first


def test_sessions_known_elsewhere_by_duplicate_are_replaced() -> None:
    for keeps in (False, True):
        bench = Bench(Quirks(keeps_duplicate=keeps))
        bench.boot()
        bench.node.receive(init_command(1, 1).encode())  # left over from somebody else
        bench.open(PLAN.pad_ranging(0))
        bench.run(2_000)
        assert bench.state() is SessionState.ACTIVE


def test_a_session_lost_again_and_again_is_given_up() -> None:
    bench = Bench()
    bench.boot()
    bench.filter = lambda packet: bytes.fromhex("4103000111") if packet[:2] == b"\x41\x03" else packet
    bench.open(PLAN.pad_ranging(0))
    bench.run(5_000)
    [ended] = bench.take(SessionEnded)
    assert isinstance(ended.error, UciStateError)
    assert "lost 5 times" in str(ended.error)


def test_data_needs_an_active_session_and_credit() -> None:
    bench = opened()
    bench.take(CreditGranted)
    with pytest.raises(UciStateError, match="not active"):
        bench.machine.send_data(2, 0xD001, b"x", bench.ms)
    bench.filter = lambda packet: b"" if packet[:2] == b"\x62\x04" else packet
    bench.machine.send_data(1, 0xD001, b"x", bench.ms)
    bench.settle()
    assert not bench.machine.has_credit(1)
    with pytest.raises(UciStateError, match="no credit"):
        bench.machine.send_data(1, 0xD001, b"x", bench.ms)
    bench.run(1_000)  # the notification was lost; time gives the credit back
    assert bench.machine.has_credit(1)
    assert CreditGranted(1) in bench.events
    bench._from_node(bytes.fromhex("62050007010000000102" + "01"))
    bench.settle()
    assert bench.take(SessionMessage) == [SessionMessage(1, DataTransferStatus(1, 1, 2, 1))]


def test_reports_reach_the_session_by_handle_and_strangers_are_ignored() -> None:
    bench = opened(Quirks(handle_offset=5))
    bench.node.sessions[6].report([], [])
    bench._from_node(
        encode_control(MessageType.NOTIFICATION, 2, 0, bytes(4) + b"\x63" + bytes(11) + b"\x01" + bytes(12))
    )
    bench.settle()
    events = bench.take(SessionMessage)
    # The second has handle 0x63, which is nobody's.
    assert [(e.session_id, e.message.sequence) for e in events if isinstance(e.message, RangeData)] == [(1, 0)]


def test_endless_garbage_ends_in_a_reset() -> None:
    bench = opened()
    rng = random.Random(1)
    for _ in range(250):
        bench.ms += 10
        bench.machine.receive_data(b"\xff" + rng.randbytes(20), bench.ms)
        bench.machine.advance(bench.ms)
        bench.events += bench.machine.events()
    assert any("garbage" in e.detail for e in bench.take(DeviceLost))
    bench.run(3_000)
    assert bench.state() is SessionState.ACTIVE


def test_a_header_longer_than_its_body_costs_a_moment() -> None:
    bench = opened()
    bench.machine.receive_data(b"\x62\x00\x00\xff" + bytes(20), bench.ms)
    bench.run(250)
    assert bench.take(StreamResynchronised) == [StreamResynchronised(24)]
    bench.node.sessions[1].report([], [])
    bench.settle()
    assert len(bench.take(SessionMessage)) == 1


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 2**32), quirk=st.integers(0, 4))
def test_whatever_the_line_did_the_session_is_active_once_it_is_quiet(seed: int, quirk: int) -> None:
    rng = random.Random(seed)
    quirks = (
        Quirks(),
        Quirks(handle_offset=9),
        Quirks(no_ready=True),
        Quirks(keeps_duplicate=True),
        Quirks(empty_data=True),
    )[quirk]
    bench = Bench(quirks)

    def spoil(packet: bytes) -> bytes:
        chance = rng.random()
        if chance < 0.1:
            return b""
        if chance < 0.15:
            return packet[: rng.randrange(len(packet))]
        if chance < 0.2:
            return rng.randbytes(rng.randrange(1, 30)) + packet
        if chance < 0.25:
            return packet + packet
        return packet

    bench.filter = spoil
    bench.boot()
    bench.open(PLAN.pad_ranging(0))
    wanted = [1]
    for _ in range(rng.randrange(2, 12)):
        bench.run(rng.randrange(1, 1_500))
        action = rng.randrange(6)
        if action == 0:
            bench.node.power_on()
        elif action == 1:
            bench.machine.port_down("gone")
            bench.settle()
            bench.node.power_off()
            bench.machine.port_up(bench.ms)
        elif action == 2 and wanted:
            bench.machine.close_session(wanted.pop(), bench.ms)
        elif action == 3:
            bench.deaf = not bench.deaf
    bench.filter = lambda packet: packet
    bench.deaf = False
    bench.run(20_000)
    ended = {e.session_id: e.error for e in bench.take(SessionEnded)}
    if wanted and 1 not in ended:
        assert bench.state() is SessionState.ACTIVE
        assert [s.session_id for s in bench.node.sessions.values() if s.state is SessionState.ACTIVE] == [1]
    else:
        # Closed as wanted, or given up because spoilt answers read as refusals: then nothing is left on the node.
        assert bench.state() is None
        assert bench.node.sessions == {}


def test_start_is_the_documented_command() -> None:
    assert start_command(1).name == "SESSION_START"
    assert Command(9, 9, b"").name == "command 0x9/0x09"
    assert Status(0x11) is Status.SESSION_NOT_EXIST
