"""The session layout of a pad and a drone: who ranges with whom, and which way the words go.

* **Session A, ranging** (20 Hz): the drone's node is controller and initiator, the pad's nodes are controlees and
  responders. Each pad node reports its own range to the drone on its own port; the drone's port reports all of them
  (a cross-check). In-band data goes drone → pad; every pad node receives it.
* **Session B, words** (10 Hz): the pad's first node is controller and initiator, the drone's node the only responder.
  In-band data goes pad → drone; it yields one more range.

Data travels from the initiator to responders only, hence two sessions. Both use provisioned STS with a key that lives
for one proof. A third session, in which the drone blinks and the pad's nodes time-stamp, is ``blinks``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from wonderland.uwb.blinks import BlinkPlan
from wonderland_fira_uci.errors import RangingPlanError
from wonderland_fira_uci.uci.config import (
    SESSION_KEY_SIZES,
    AppConfig,
    DeviceRole,
    DeviceType,
    MultiNodeMode,
    SessionConfig,
    least_slots,
)
from wonderland_fira_uci.uci.status import SessionType

RSTU_PER_MS: Final = 1200
MAX_PAD_NODES: Final = 8
CHANNELS: Final = (5, 6, 8, 9, 10, 12, 13, 14)
# IEEE 802.15.4z code indices for the base (9-24) and higher pulse repetition modes (25-32).
PREAMBLE_CODES: Final = range(9, 33)


@dataclass(frozen=True, slots=True, kw_only=True)
class RangingPlan:
    """What pad and drone must agree on before the first radio frame.

    ``session_a_id``/``session_b_id``: 32-bit, distinct. ``pad_macs``: 16-bit short addresses of the pad's nodes in
    anchor order; the first also speaks session B. ``sts_key``: 16 octets, hidden from ``repr``. Intervals are in
    milliseconds, slots in ranging scheduling time units (1200 per millisecond). Raises ``RangingPlanError``.
    """

    session_a_id: int
    session_b_id: int
    pad_macs: tuple[int, ...]
    uav_mac: int
    sts_key: bytes = field(repr=False)
    channel: int = 9
    preamble_code: int = 10
    interval_a_ms: int = 50
    interval_b_ms: int = 100
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
        for name in ("interval_a_ms", "interval_b_ms"):
            if not 1 <= getattr(self, name) <= 60_000:
                raise RangingPlanError(f"{name}: {getattr(self, name)} is not within 1 to 60000")
        ranging_ms, words_ms = self._round_ms(len(self.pad_macs)), self._round_ms(1)
        if ranging_ms + words_ms * self.interval_a_ms / self.interval_b_ms > self.interval_a_ms:
            raise RangingPlanError(
                f"interval_a_ms: rounds of {ranging_ms:g} ms and of {words_ms:g} ms do not fit; "
                "lengthen the intervals, or use fewer nodes or shorter slots"
            )

    def _round_ms(self, responders: int) -> float:
        """Time on air of one round."""
        return least_slots(responders) * self.slot_duration_rstu / RSTU_PER_MS

    def _app(
        self, *, lead: bool, mode: MultiNodeMode, mac: int, peers: tuple[int, ...], responders: int, interval_ms: int
    ) -> AppConfig:
        return AppConfig(
            device_type=DeviceType.CONTROLLER if lead else DeviceType.CONTROLEE,
            device_role=DeviceRole.INITIATOR if lead else DeviceRole.RESPONDER,
            multi_node_mode=mode,
            mac_address=mac,
            destination_macs=peers,
            interval_ms=interval_ms,
            channel=self.channel,
            preamble_code=self.preamble_code,
            slot_duration_rstu=self.slot_duration_rstu,
            slots_per_round=least_slots(responders),
            rssi_reporting=1,
            session_key=self.sts_key,
        )

    def _session(self, session_id: int, app: AppConfig) -> SessionConfig:
        return SessionConfig(session_id=session_id, app=app, session_type=SessionType.RANGING_WITH_DATA)

    def pad_ranging(self, index: int) -> SessionConfig:
        """Session A for the pad's node ``index`` (0 is the first anchor)."""
        if not 0 <= index < len(self.pad_macs):
            raise RangingPlanError(f"pad node {index}: the plan has {len(self.pad_macs)} nodes")
        app = self._app(
            lead=False,
            mode=MultiNodeMode.ONE_TO_MANY,
            mac=self.pad_macs[index],
            peers=(self.uav_mac,),
            responders=len(self.pad_macs),
            interval_ms=self.interval_a_ms,
        )
        return self._session(self.session_a_id, app)

    def uav_ranging(self) -> SessionConfig:
        """Session A for the drone's node."""
        app = self._app(
            lead=True,
            mode=MultiNodeMode.ONE_TO_MANY,
            mac=self.uav_mac,
            peers=self.pad_macs,
            responders=len(self.pad_macs),
            interval_ms=self.interval_a_ms,
        )
        return self._session(self.session_a_id, app)

    def pad_words(self) -> SessionConfig:
        """Session B for the pad's first node."""
        app = self._app(
            lead=True,
            mode=MultiNodeMode.UNICAST,
            mac=self.pad_macs[0],
            peers=(self.uav_mac,),
            responders=1,
            interval_ms=self.interval_b_ms,
        )
        return self._session(self.session_b_id, app)

    def uav_words(self) -> SessionConfig:
        """Session B for the drone's node."""
        app = self._app(
            lead=False,
            mode=MultiNodeMode.UNICAST,
            mac=self.uav_mac,
            peers=(self.pad_macs[0],),
            responders=1,
            interval_ms=self.interval_b_ms,
        )
        return self._session(self.session_b_id, app)
