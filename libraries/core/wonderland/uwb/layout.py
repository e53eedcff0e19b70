"""The radio plan of a session: who ranges with whom, which way the words go, and when each node's one radio does what.

* **Session A, ranging**: the drone's node is controller and initiator, the pad's nodes are controlees and responders.
  Each pad node reports its own range to the drone on its own port; the drone's port reports all of them (a
  cross-check). Its initiation frames carry data drone → pad, which every pad node receives. Where responders can carry
  data as well, their response frames carry it pad → drone, and A is the only session.
* **Session B, words**, where data travels from the initiator to responders only: one of the pad's nodes is controller
  and initiator, the drone's node the only responder. In-band data goes pad → drone; it yields one more range.
* **Session C, blinks** (``blinks``): the drone blinks and the pad's nodes time-stamp; another one for a witness.

A node has one half-duplex radio. So all of them share one block: A's round, then B's, then the blinks, each in slots of
its own by SESSION_TIME_BASE; the block is as short as the slots allow, but for a few milliseconds (``steps_ms``). All
use provisioned STS with keys that live for one proof, in SP1 frames, which carry data and the scrambled sequence.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final, Literal

from wonderland.uwb.blinks import BLINK_SLOTS, BlinkPlan
from wonderland_fira_uci.errors import RangingPlanError
from wonderland_fira_uci.uci.airtime import RSTU_PER_MS, frame_us, measured_ago_ms, slot_us
from wonderland_fira_uci.uci.config import (
    SESSION_KEY_SIZES,
    AppConfig,
    DeviceRole,
    DeviceType,
    MultiNodeMode,
    RframeConfig,
    SessionConfig,
    TimeBase,
    least_slots,
)
from wonderland_fira_uci.uci.status import SessionType

MAX_PAD_NODES: Final = 8
CHANNELS: Final = (5, 6, 8, 9, 10, 12, 13, 14)
# IEEE 802.15.4z code indices for the base (9-24) and higher pulse repetition modes (25-32).
PREAMBLE_CODES: Final = range(9, 33)
TURN_US: Final = 200
"""Between two frames a chip needs at least so long to turn round."""
GUARD_US: Final = 500
"""Left free at the end of a block, for clocks that drift."""
STEPS_MS: Final = 4
"""Blocks of different sessions differ in length, so that two of them on one channel slide past each other: in step, one
drone's frames drown the same anchor's answer in every round."""

WordWays = Literal["both_ways", "initiator"]


def steps_ms(session_a_id: int) -> int:
    """How much longer than needed a session's blocks are (ms): by other bits of its id than the preamble code."""
    return session_a_id // 8 % STEPS_MS


@dataclass(frozen=True, slots=True, kw_only=True)
class RangingPlan:
    """What pad and drone must agree on before the first radio frame.

    ``session_a_id``/``session_b_id``: 32-bit, distinct. ``pad_macs``: 16-bit short addresses of the pad's nodes in
    anchor order. ``sts_key``: 16 octets, hidden from ``repr``. ``words``: who carries data in a ranging session.
    ``word_octets``: the most that one frame takes. Slots are in ranging scheduling time units (1200 per millisecond).
    Raises ``RangingPlanError``.
    """

    session_a_id: int
    session_b_id: int
    pad_macs: tuple[int, ...]
    uav_mac: int
    sts_key: bytes = field(repr=False)
    channel: int = 9
    preamble_code: int = 10
    words: WordWays = "both_ways"
    word_octets: int = 84
    slot_duration_rstu: int = 2400
    blinks: BlinkPlan | None = None
    """Session C, for pads whose nodes share a clock."""
    witness_blinks: BlinkPlan | None = None
    """The same for a second pad that is the witness."""

    def __post_init__(self) -> None:
        for name in ("session_a_id", "session_b_id"):
            if not 0 < getattr(self, name) <= 0xFFFFFFFF:
                raise RangingPlanError(f"{name}: {getattr(self, name)} is not within 1 to 2^32-1")
        if self.session_a_id == self.session_b_id:
            raise RangingPlanError("session_b_id: must differ from session_a_id")
        if not 1 <= len(self.pad_macs) <= MAX_PAD_NODES:
            raise RangingPlanError(f"pad_macs: {len(self.pad_macs)} given, 1 to {MAX_PAD_NODES} allowed")
        macs = (*self.pad_macs, self.uav_mac)
        if any(not 0 < mac < 0xFFFE for mac in macs):
            raise RangingPlanError("pad_macs, uav_mac: short addresses are within 0x0001 to 0xfffd")
        if len(set(macs)) != len(macs):
            raise RangingPlanError("pad_macs, uav_mac: two nodes share an address")
        if len(self.sts_key) not in SESSION_KEY_SIZES:
            raise RangingPlanError(f"sts_key: {len(self.sts_key)} octets; 16 or 32 are needed")
        if self.channel not in CHANNELS:
            raise RangingPlanError(f"channel: {self.channel} is no high-rate UWB channel {CHANNELS}")
        if self.preamble_code not in PREAMBLE_CODES:
            raise RangingPlanError(f"preamble_code: {self.preamble_code} is not within 9 to 32")
        if not 1 <= self.slot_duration_rstu <= 0xFFFF:
            raise RangingPlanError(f"slot_duration_rstu: {self.slot_duration_rstu} is not within 1 to 65535")
        least_us = frame_us(RframeConfig.SP1, self.word_octets) + TURN_US
        if slot_us(self.slot_duration_rstu) < least_us:
            raise RangingPlanError(
                f"slot_duration_rstu: a frame with {self.word_octets} octets of data and the turn after it take "
                f"{least_us:.0f} µs; at least {-(-least_us * RSTU_PER_MS // 1_000):.0f} are needed"
            )

    @property
    def interval_ms(self) -> int:
        """Length of a block: one round of each session, and ``STEPS_MS`` by the session's id."""
        return int(-(-(self._after_us(_WITNESS) + GUARD_US) // 1_000)) + steps_ms(self.session_a_id)

    @property
    def measured_ago_ms(self) -> int:
        """How long nodes have measured when they report a round."""
        return measured_ago_ms(len(self.pad_macs), self.slot_duration_rstu)

    def _after_us(self, part: int) -> int:
        """Where a part of the block ends."""
        slots = (
            least_slots(len(self.pad_macs)),
            least_slots(1) if self.words == "initiator" else 0,
            BLINK_SLOTS if self.blinks is not None else 0,
            BLINK_SLOTS if self.witness_blinks is not None else 0,
        )
        return int(-(-sum(slots[: part + 1]) * slot_us(self.slot_duration_rstu) // 1))

    def _app(self, *, lead: bool, mode: MultiNodeMode, mac: int, peers: tuple[int, ...], responders: int) -> AppConfig:
        return AppConfig(
            device_type=DeviceType.CONTROLLER if lead else DeviceType.CONTROLEE,
            device_role=DeviceRole.INITIATOR if lead else DeviceRole.RESPONDER,
            multi_node_mode=mode,
            mac_address=mac,
            destination_macs=peers,
            interval_ms=self.interval_ms,
            channel=self.channel,
            preamble_code=self.preamble_code,
            slot_duration_rstu=self.slot_duration_rstu,
            slots_per_round=least_slots(responders),
            rssi_reporting=1,
            session_key=self.sts_key,
        )

    def _ranging(self, *, lead: bool, mac: int, peers: tuple[int, ...]) -> SessionConfig:
        app = self._app(lead=lead, mode=MultiNodeMode.ONE_TO_MANY, mac=mac, peers=peers, responders=len(self.pad_macs))
        return SessionConfig(session_id=self.session_a_id, app=app, session_type=SessionType.RANGING_WITH_DATA)

    def _words(self, *, lead: bool, mac: int, peer: int) -> SessionConfig | None:
        if self.words == "both_ways":
            return None
        app = self._app(lead=lead, mode=MultiNodeMode.UNICAST, mac=mac, peers=(peer,), responders=1)
        return SessionConfig(
            session_id=self.session_b_id,
            app=app,
            session_type=SessionType.RANGING_WITH_DATA,
            time_base=TimeBase(self.session_a_id, self._after_us(_RANGING)),
        )

    def pad_ranging(self, index: int) -> SessionConfig:
        """Session A for the pad's node ``index`` (0 is the first anchor)."""
        return self._ranging(lead=False, mac=self._pad_mac(index), peers=(self.uav_mac,))

    def uav_ranging(self) -> SessionConfig:
        """Session A for the drone's node."""
        return self._ranging(lead=True, mac=self.uav_mac, peers=self.pad_macs)

    def pad_words(self, index: int = 0) -> SessionConfig | None:
        """Session B for the pad's node that speaks; None where it speaks in session A."""
        return self._words(lead=True, mac=self._pad_mac(index), peer=self.uav_mac)

    def uav_words(self, index: int = 0) -> SessionConfig | None:
        """Session B for the drone's node; None where it hears the pad in session A."""
        return self._words(lead=False, mac=self.uav_mac, peer=self._pad_mac(index))

    def timed_blinks(self) -> BlinkPlan | None:
        """The blinks for this pad in their part of the block."""
        return self._timed(self.blinks, _WORDS)

    def timed_witness_blinks(self) -> BlinkPlan | None:
        """The blinks for a witness in theirs."""
        return self._timed(self.witness_blinks, _BLINKS)

    def _timed(self, blinks: BlinkPlan | None, before: int) -> BlinkPlan | None:
        if blinks is None:
            return None
        return replace(
            blinks,
            interval_ms=self.interval_ms,
            slot_duration_rstu=self.slot_duration_rstu,
            time_base=TimeBase(self.session_a_id, self._after_us(before)),
        )

    def _pad_mac(self, index: int) -> int:
        if not 0 <= index < len(self.pad_macs):
            raise RangingPlanError(f"pad node {index}: the plan has {len(self.pad_macs)} nodes")
        return self.pad_macs[index]


_RANGING, _WORDS, _BLINKS, _WITNESS = range(4)
"""The parts of a block, in their order."""
