"""What a real board said, replayed through the real codec and the host's state machine.

The octets are what a DWM3001CDK (QM33 SDK 1.1.1, UCI firmware, USB serial port) answered, as published in the repository
EstebanMenti/i-mop-qorvo-uci-script (its reference of commands, its validation reports, the captures that its tests
quote). They are facts about the board: nothing of that repository's code or text, which is all rights reserved, stands
here. What it reports in words (how many of 45 rounds had a negative distance) is rebuilt and marked so.
"""

from __future__ import annotations

from typing import Any

import pytest

from wonderland.uwb.reach import reach
from wonderland_fira_uci.uci.config import AppConfig, DeviceRole, DeviceType, MultiNodeMode, SessionConfig, StsConfig
from wonderland_fira_uci.uci.device import Phase, UciDevice
from wonderland_fira_uci.uci.device_events import DeviceReady, SessionChanged, SessionEnded, SessionMessage
from wonderland_fira_uci.uci.ranging import INVALID_DISTANCE_CM, RangeData
from wonderland_fira_uci.uci.session import DeviceInfo
from wonderland_fira_uci.uci.status import SessionState, Status
from wonderland_simulator.uci_node import DWM3001CDK, VirtualNode

RESET = ("2000000100", "6001000101 4000000100 6001000101")
"""READY, the answer, READY again."""
INFO = (
    "20020000",
    (
        "4002003e 00 0200 0200 0200 0110 34 0101000000000000000000000000000000 5056345832300ee0ca09"
        "00000000000000000000000000000000000000000203cade00"
    ),
)
CAPABILITIES = (
    "20030000",
    (
        "4003005e 00 1a 00020301 0102ff00 020402000200 030402000200 040103 05020300 06021e00 070119 080103 090102 0a0102"
        "0b0101 0c0101 0d0101 0e0109 0f010a 100101 11013f 12050000000000 130100 140100 150100 160102 170100 180100 190100"
    ),
)
INIT = ("2100000507000000 00", "4100000500 01000000 61020006 01000000 00 00")
"""For session 7; the handle is 1."""
CONFIGURED = "4103000200 00 61020006 01000000 03 00"
START = ("2200000401000000", "4200000100 6001000102 61020006 01000000 02 00")
ROUND = (
    "62000038 {sequence} 01000000 00 c8000000 01 00 00 0000000000000000 01"
    "0100 {status} ff {distance} 0000 00 0000 00 0000 00 0000 00 02 00 0000000000000000000000"
)
"""Its first two rounds, alone: status 21, distance ffff, NLOS ff (not known)."""
STOP = ("2201000401000000", "4201000100 61020006 01000000 03 00 6001000101")
DEINIT = ("2101000401000000", "4101000100 61020006 01000000 01 00")
NOT_CONFIGURED = "4200000115"
"""START of a session that was given five parameters only."""


def octets(text: str) -> bytes:
    return bytes.fromhex(text.replace(" ", ""))


def round_of(sequence: int, status: int = 0x21, distance_cm: int = INVALID_DISTANCE_CM) -> bytes:
    where = {"sequence": sequence.to_bytes(4, "little").hex(), "distance": distance_cm.to_bytes(2, "little").hex()}
    return octets(ROUND.format(**where, status=f"{status:02x}"))


class Board:
    """The host's machine, and a board that says what was captured."""

    def __init__(self) -> None:
        self.ms = 1_000
        self.host = UciDevice()
        self.events: list[Any] = []

    def said(self, text: str | bytes) -> None:
        self.host.receive_data(text if isinstance(text, bytes) else octets(text), self.ms)
        self.events += self.host.events()

    def exchange(self, sent: str, answer: str) -> None:
        assert self.host.data_to_send() == octets(sent)
        self.said(answer)

    def take(self, kind: type) -> list[Any]:
        out = [event for event in self.events if isinstance(event, kind)]
        self.events = [event for event in self.events if not isinstance(event, kind)]
        return out


def booted() -> Board:
    board = Board()
    board.host.port_up(board.ms)
    for sent, answer in (RESET, INFO, CAPABILITIES):
        board.exchange(sent, answer)
    return board


def config() -> SessionConfig:
    app = AppConfig(
        device_type=DeviceType.CONTROLLER,
        device_role=DeviceRole.INITIATOR,
        multi_node_mode=MultiNodeMode.UNICAST,
        mac_address=0x0000,
        destination_macs=(0x0001,),
        interval_ms=200,
        sts_config=StsConfig.STATIC,
    )
    return SessionConfig(session_id=7, app=app, session_type=0)


def ranging() -> Board:
    board = booted()
    board.host.open_session(config(), board.ms)
    board.exchange(*INIT)
    configuration = board.host.data_to_send()
    assert (configuration[:3], configuration[4:8]) == (octets("210300"), octets("01000000")), "the handle, not the id"
    board.said(CONFIGURED)
    board.exchange(*START)
    return board


def test_a_board_that_is_ready_twice_boots_once() -> None:
    board = booted()
    assert board.host.phase is Phase.READY
    [ready] = board.take(DeviceReady)
    assert ready.info == DWM3001CDK.info
    assert isinstance(ready.info, DeviceInfo)
    assert (ready.info.uci_version, ready.info.test_version, len(ready.info.vendor)) == (0x0002, 0x1001, 52)
    assert board.events == []
    assert board.host.data_to_send() == b""


def test_what_the_board_can_do_is_understood_and_bears_assurance_2() -> None:
    board = booted()
    said = board.host.capabilities
    assert said is not None
    assert (said.max_message_octets, said.max_data_payload_octets) == (259, 255)
    assert (said.channels, said.bprf_sets, said.hprf_sets) == ((5, 9), (1, 2, 3, 4, 5, 6), ())
    assert (said.angle_of_arrival, said.extended_mac, said.dt_anchor_rounds) == (0, False, 0)
    assert (said.unknown, said.skipped) == ((), 0)
    found = reach({"A1": said, "A2": said, "A3": said, "A4": said}, said)
    assert found.level == 2
    assert all("UL-TDoA" in each.capability for each in found.missing)


def test_the_virtual_board_says_the_same_octets() -> None:
    said: list[bytes] = []
    node = VirtualNode("board", None)  # type: ignore[arg-type] - nothing goes on the air
    node.transmit = said.append
    for sent, answer in (RESET, INFO, CAPABILITIES, INIT):
        said.clear()
        node.receive(octets(sent))
        assert b"".join(said) == octets(answer)


def test_a_session_under_another_handle_ranges_and_ends() -> None:
    board = ranging()
    board.said(round_of(0) + round_of(1))
    assert [each.change.state for each in board.take(SessionChanged)] == [
        SessionState.INIT,
        SessionState.IDLE,
        SessionState.ACTIVE,
    ]
    heard = [each.message for each in board.take(SessionMessage)]
    assert [(each.sequence, each.handle, each.interval_ms) for each in heard] == [(0, 1, 200), (1, 1, 200)]
    for report in heard:
        assert isinstance(report, RangeData)
        [record] = report.two_way
        assert (record.mac_address, record.status, record.range_mm, record.slot_index) == (
            *(0x0001, Status.RANGING_RX_TIMEOUT),
            *(None, 2),
        )
        assert record.obstructed is None, "this firmware does not tell"
        assert record.rssi_dbm is None
    board.host.close_session(7, board.ms)
    board.exchange(*STOP)
    board.exchange(*DEINIT)
    [ended] = board.take(SessionEnded)
    assert (ended.session_id, ended.error) == (7, None)


def test_negative_distances_are_no_distances() -> None:
    """Two boards close to each other, not calibrated: 2 of 45 rounds had a distance (0 to 1 cm), 43 the status 1b.

    Rebuilt: the rounds are the captured one with the reported status; what stands in the distance then nobody wrote.
    """
    board = ranging()
    for number in range(45):
        given = number in (11, 30)
        board.said(round_of(number, 0x00 if given else 0x1B, number % 2 if given else INVALID_DISTANCE_CM))
    records = [each.message.two_way[0] for each in board.take(SessionMessage)]
    assert [r.range_mm for r in records if r.range_mm is not None] == [10, 0]
    assert {r.status for r in records if r.range_mm is None} == {Status.NEGATIVE_DISTANCE}


@pytest.mark.parametrize("distance_cm", [0, 67])
def test_the_distances_that_it_measured(distance_cm: int) -> None:
    """In two runs of 45 rounds 23 and 17 had one, of 0 to 67 cm (rebuilt as above)."""
    board = ranging()
    board.said(round_of(0, 0x00, distance_cm))
    [heard] = board.take(SessionMessage)
    assert heard.message.two_way[0].range_mm == 10 * distance_cm


def test_a_start_that_lacks_parameters_is_asked_about_and_given_up() -> None:
    board = booted()
    board.host.open_session(config(), board.ms)
    board.exchange(*INIT)
    board.host.data_to_send()
    board.said(CONFIGURED)
    sent = []
    for _ in range(10):
        out = board.host.data_to_send()
        sent.append(out)
        if out == octets(START[0]):
            board.said(NOT_CONFIGURED)
        elif out == octets("2106000401000000"):  # asks for the state
            board.said("41060002 00 03")
        else:
            break
    assert sent.count(octets(START[0])) == 3
    assert out == octets(DEINIT[0])
    board.said(DEINIT[1])
    [ended] = board.take(SessionEnded)
    assert "SESSION_NOT_CONFIGURED" in str(ended.error)


def test_a_node_that_wants_to_be_asked_again_is() -> None:
    """NXP's public data demo (SR150): DEINIT right after the end is answered by a generic error, 0a (COMMAND_RETRY)."""
    board = ranging()
    board.host.close_session(7, board.ms)
    board.exchange(*STOP)
    board.exchange(DEINIT[0], "60070001 0a")
    board.exchange(*DEINIT)
    assert board.take(SessionEnded)[0].error is None
