"""Session C: the drone's node blinks, a pad's nodes time-stamp the same blink on their common clock (UL-TDoA).

The first of the pad's nodes is the synchronisation anchor, on whose frames the others lock; the drone's node is the
tag. No node of the pad answers, and the drone says no time: so nothing in it rests on the drone's word. The tag's host
hands over a payload (the answer to the pad's challenge) as in-band data; it rides in every blink until it is replaced.
The sequence that is time-stamped is keyed for one proof, as in the other sessions. Blinks have slots of their own after
the rounds of another session, since a node has one radio: one for the synchronisation, one for the blink, and as much
again in which it comes at random, so that nobody can time a frame over it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

from wonderland.proofs.keys import SessionKeys
from wonderland.proofs.records.pads import Commissioning
from wonderland_fira_uci.errors import RangingPlanError
from wonderland_fira_uci.uci.airtime import RSTU_PER_MS, slot_us
from wonderland_fira_uci.uci.config import (
    MAX_CONTROLEES,
    SESSION_KEY_SIZES,
    AppConfig,
    DeviceRole,
    DeviceType,
    MultiNodeMode,
    ParameterId,
    RangingUsage,
    SessionConfig,
    TimeBase,
    least_slots,
)
from wonderland_fira_uci.uci.status import SessionType

MAX_PAYLOAD: Final = 16
BLINK_SLOTS: Final = 3
_REPORT_BLINKS: Final = b"\x01"
"""UL_TDOA_NTF_REPORT_CONFIG: each blink is reported, with its payload."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BlinkPlan:
    """What a drone and a pad agree on for blinks.

    ``pad_macs``: short addresses of the pad's nodes, the synchronisation anchor first. ``interval_ms``: between two
    blinks. ``time_base``: which session's rounds they follow; None for who only listens. Raises ``RangingPlanError``.
    """

    session_id: int
    pad_macs: tuple[int, ...]
    uav_mac: int
    sts_key: bytes = field(repr=False)
    channel: int = 9
    preamble_code: int = 11
    interval_ms: int = 50
    slot_duration_rstu: int = 2400
    time_base: TimeBase | None = None
    payload: bytes = field(default=b"", repr=False)
    """What the blinks carry from the first one on."""

    def __post_init__(self) -> None:
        if not 0 < self.session_id <= 0xFFFFFFFF:
            raise RangingPlanError(f"session_id: {self.session_id} is not within 1 to 2^32-1")
        if not 1 <= len(self.pad_macs) <= MAX_CONTROLEES:
            raise RangingPlanError(f"pad_macs: {len(self.pad_macs)} given, 1 to {MAX_CONTROLEES} allowed")
        macs = (*self.pad_macs, self.uav_mac)
        if len(set(macs)) != len(macs) or any(not 0 < mac < 0xFFFE for mac in macs):
            raise RangingPlanError("pad_macs, uav_mac: distinct short addresses within 0x0001 to 0xfffd are needed")
        if len(self.sts_key) not in SESSION_KEY_SIZES:
            raise RangingPlanError(f"sts_key: {len(self.sts_key)} octets; 16 or 32 are needed")
        if len(self.payload) > MAX_PAYLOAD:
            raise RangingPlanError(f"payload: {len(self.payload)} octets; at most {MAX_PAYLOAD} fit into a blink")
        if not BLINK_SLOTS * slot_us(self.slot_duration_rstu) <= 1_000 * self.interval_ms <= 60_000_000:
            text = f"{self.interval_ms} ms; {BLINK_SLOTS} slots have to fit, and at most a minute is allowed"
            raise RangingPlanError(f"interval_ms: {text}")

    def pad_anchor(self, index: int) -> SessionConfig:
        """For the pad's node ``index``; the first synchronises the others."""
        if not 0 <= index < len(self.pad_macs):
            raise RangingPlanError(f"pad node {index}: the plan has {len(self.pad_macs)} nodes")
        role = DeviceRole.UT_SYNCHRONISATION_ANCHOR if index == 0 else DeviceRole.UT_ANCHOR
        extra = ((ParameterId.UL_TDOA_NTF_REPORT_CONFIG, _REPORT_BLINKS),)
        return self._session(DeviceType.CONTROLEE, role, self.pad_macs[index], (self.uav_mac,), extra)

    def uav_tag(self) -> SessionConfig:
        """For the drone's node."""
        extra = (
            (ParameterId.UL_TDOA_TX_INTERVAL, self.interval_ms.to_bytes(4, "little")),
            (ParameterId.UL_TDOA_RANDOM_WINDOW, int(slot_us(self.slot_duration_rstu) // 1_000).to_bytes(4, "little")),
            (ParameterId.UL_TDOA_DEVICE_ID, b"\x00"),
            (ParameterId.UL_TDOA_TX_TIMESTAMP, b"\x00"),
        )
        return self._session(DeviceType.CONTROLLER, DeviceRole.UT_TAG, self.uav_mac, self.pad_macs, extra)

    def _session(
        self,
        kind: DeviceType,
        role: DeviceRole,
        mac: int,
        peers: tuple[int, ...],
        extra: tuple[tuple[int, bytes], ...],
    ) -> SessionConfig:
        app = AppConfig(
            device_type=kind,
            device_role=role,
            multi_node_mode=MultiNodeMode.ONE_TO_MANY,
            ranging_usage=RangingUsage.UL_TDOA,
            sfd_id=0,
            slot_duration_rstu=self.slot_duration_rstu,
            mac_address=mac,
            destination_macs=peers,
            interval_ms=self.interval_ms,
            channel=self.channel,
            preamble_code=self.preamble_code,
            slots_per_round=BLINK_SLOTS,
            session_key=self.sts_key,
            extra=extra,
        )
        return SessionConfig(
            session_id=self.session_id,
            app=app,
            session_type=SessionType.RANGING_WITH_DATA,
            time_base=self.time_base,
        )


def blinks_beside(
    session_id: int,
    pad_macs: tuple[int, ...],
    tag_mac: int,
    key: bytes,
    interval_ms: int,
    *,
    channel: int = 9,
    slot_us: int = 2_000,
) -> BlinkPlan:
    """The blinks of a calibration run after each round of its ranging session: the next id, the same key and channel.

    Raises RangingPlanError.
    """
    plan = BlinkPlan(
        session_id=session_id % 0xFFFFFFFF + 1,
        pad_macs=pad_macs,
        uav_mac=tag_mac,
        sts_key=key,
        interval_ms=interval_ms,
        channel=channel,
        slot_duration_rstu=slot_us * RSTU_PER_MS // 1_000,
    )
    round_us = least_slots(len(pad_macs)) * slot_us
    return replace(plan, time_base=TimeBase(session_id, round_us))


def blink_plan(keys: SessionKeys, commissioning: Commissioning, payload: bytes = b"") -> BlinkPlan | None:
    """The blinks of a session at a pad; None where its nodes share no clock that was commissioned."""
    if commissioning.timestamp_sigma_mm is None:
        return None
    return BlinkPlan(
        session_id=keys.session_c,
        pad_macs=tuple(anchor.mac for anchor in commissioning.anchors),
        uav_mac=keys.uav_mac,
        sts_key=keys.sts_key_blinks,
        payload=payload,
    )
