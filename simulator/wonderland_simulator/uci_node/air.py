"""The air between virtual nodes: who hears whom, in rounds, and what they measure.

A round is led by the session's controller, at its interval. The channel itself (geometry, noise, obstruction,
attackers at the physical layer) is the caller's ``measure``. Blinks (UL-TDoA) are led by the tag and go one way: what
each anchor's clock shows when it hears one is the caller's ``stamp``.
"""

from __future__ import annotations

import asyncio
import random
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

from wonderland_fira_uci.uci.config import AppConfig, DeviceRole, DeviceType, MultiNodeMode, ParameterId, RangingUsage
from wonderland_fira_uci.uci.data import DataReceive
from wonderland_fira_uci.uci.ranging import (
    CLOCK_BITS,
    INVALID_DISTANCE_CM,
    FrameType,
    LineOfSight,
    OneWayMeasurement,
    TwoWayMeasurement,
)
from wonderland_fira_uci.uci.status import Status

if TYPE_CHECKING:
    from wonderland_simulator.uci_node.node import NodeSession

DATA_SEQUENCE: Final = 1
"""Nodes do not count what they hear; every DATA_MESSAGE_RCV carries this number."""


class Measurement(NamedTuple):
    """What one node measures to another in one round. ``range_mm`` None: not heard (``status`` then says why)."""

    range_mm: int | None
    nlos: bool | None = False
    rssi_dbm: float | None = None
    status: int = Status.OK


Measure = Callable[[str, str, float], Measurement]
"""``measure(observer, peer, t_s)``: names of the nodes, the Air's clock.

Called once for each observer of a pair in a round, with the same ``t_s`` for all: keep what was drawn for a pair and
a time if both ends shall report the same."""

Stamp = Callable[[str, str, float], int | None]
"""``stamp(anchor, tag, t_s)``: the anchor's counter (15.65 ps) on hearing the tag's frame of ``t_s``, or None."""

Intercept = Callable[[str, str, bytes], bytes | None]
"""``intercept(sender, receiver, data)``: what arrives instead, or None for nothing."""


@dataclass(slots=True)
class _Group:
    """The active sessions that share an id."""

    members: list[NodeSession] = field(default_factory=list)
    timer: asyncio.TimerHandle | None = None
    due_s: float = 0.0
    blinks: int = 0


class Air:
    """Joins virtual nodes of one process and one event loop.

    ``data_loss``: probability that a data frame is not heard by a responder. ``jitter_ms``: reports of one round reach
    the ports up to that much later, each on its own. ``clock_s``: what ``measure`` is asked about. Without ``stamp`` no
    nodes share a clock, and blinks are not heard.
    """

    def __init__(
        self,
        measure: Measure,
        *,
        rng: random.Random,
        data_loss: float = 0.0,
        jitter_ms: float = 3.0,
        intercept: Intercept | None = None,
        clock_s: Callable[[], float] = time.monotonic,
        stamp: Stamp | None = None,
    ) -> None:
        self.measure = measure
        self.data_loss = data_loss
        self.jitter_ms = jitter_ms
        self.intercept = intercept
        self.stamp = stamp
        self.rounds = 0
        self._rng = rng
        self._clock_s = clock_s
        self._groups: dict[int, _Group] = {}

    def join(self, session: NodeSession) -> None:
        """A session became active; its first round comes one interval later."""
        group = self._groups.setdefault(session.session_id, _Group())
        group.members.append(session)
        leads = session.app.device_type is DeviceType.CONTROLLER
        if group.timer is None or leads:
            self._schedule(session.session_id, group, asyncio.get_running_loop().time())

    def leave(self, session: NodeSession) -> None:
        """A session is no longer active."""
        group = self._groups.get(session.session_id)
        if group is None or session not in group.members:
            return
        group.members.remove(session)
        if not group.members:
            if group.timer is not None:
                group.timer.cancel()
            del self._groups[session.session_id]

    def close(self) -> None:
        """Ends all rounds."""
        for group in self._groups.values():
            if group.timer is not None:
                group.timer.cancel()
        self._groups.clear()

    @staticmethod
    def _leader(group: _Group) -> NodeSession | None:
        return next((s for s in group.members if s.app.device_type is DeviceType.CONTROLLER), None)

    def _schedule(self, session_id: int, group: _Group, from_s: float) -> None:
        if group.timer is not None:
            group.timer.cancel()
        pace = self._leader(group) or group.members[0]
        loop = asyncio.get_running_loop()
        group.due_s = from_s + pace.app.interval_ms / 1000 * (1 + pace.node.quirks.drift)
        window_ms = _parameter(pace.app, ParameterId.UL_TDOA_RANDOM_WINDOW)
        if window_ms:
            group.due_s += self._rng.uniform(-0.5, 0.5) * window_ms / 1000
        if group.due_s < loop.time() - 1:  # the process was stopped for a while: no rounds to catch up
            group.due_s = loop.time()
        group.timer = loop.call_at(group.due_s, self._round, session_id)

    def _round(self, session_id: int) -> None:
        group = self._groups[session_id]
        self._schedule(session_id, group, group.due_s)
        self.rounds += 1
        leader = self._leader(group)
        if leader is None:
            for session in group.members:
                self._later(session, [], [])
            return
        t_s = self._clock_s()
        if leader.app.ranging_usage is RangingUsage.UL_TDOA:
            self._blink(group, leader, t_s)
            return
        led: list[TwoWayMeasurement] = []
        frames = leader.take_data()
        for mac in leader.app.destination_macs:
            follower = next((s for s in group.members if s is not leader and s.app.mac_address == mac), None)
            heard = follower is not None and _same_air(leader.app, follower.app)
            if follower is None or not heard:
                led.append(_failed(mac, Status.RANGING_RX_TIMEOUT))
                continue
            status = Status.OK if _same_key(leader.app, follower.app) else Status.RANGING_RX_PHY_STS_FAILED
            if status is not Status.OK:
                led.append(_failed(mac, status))
                self._later(follower, [_failed(leader.app.mac_address, status)], [])
                continue
            led.append(self._record(leader, follower, t_s))
            answer = self._record(follower, leader, t_s)
            through = led[-1].status == Status.OK and answer.status == Status.OK
            self._later(follower, [answer], self._deliver(leader, follower, frames) if through else [])
        for session in group.members:
            if session is not leader and session.app.mac_address not in leader.app.destination_macs:
                self._later(session, [], [])
        self._rng.shuffle(led)
        self._later(leader, led, [])

    def _blink(self, group: _Group, tag: NodeSession, t_s: float) -> None:
        """One frame of a tag, time-stamped by whoever listens with the same key."""
        for _, data in tag.take_data():
            tag.blink_payload = data
        group.blinks += 1
        for anchor in group.members:
            if anchor is tag or self.stamp is None or not _hears_blinks(tag.app, anchor.app):
                continue
            ticks = self.stamp(anchor.node.name, tag.node.name, t_s)
            if ticks is None:
                continue
            record = OneWayMeasurement(
                tag.app.mac_address,
                FrameType.BLINK,
                LineOfSight.CLEAR,
                0,
                0,
                0,
                0,
                ticks % (1 << CLOCK_BITS),
                group.blinks,
                b"",
                tag.blink_payload,
            )
            if self.jitter_ms <= 0:
                anchor.report_blink((record,))
            else:
                delay_s = self._rng.random() * self.jitter_ms / 1000
                asyncio.get_running_loop().call_later(delay_s, anchor.report_blink, (record,))

    def _record(self, observer: NodeSession, peer: NodeSession, t_s: float) -> TwoWayMeasurement:
        measured = self.measure(observer.node.name, peer.node.name, t_s)
        mac = peer.app.mac_address
        if measured.range_mm is None or measured.status != Status.OK:
            return _failed(mac, measured.status or Status.RANGING_RX_TIMEOUT)
        distance_cm = max((measured.range_mm + 5) // 10, 0)
        if distance_cm >= INVALID_DISTANCE_CM:
            return _failed(mac, Status.RANGING_RX_TIMEOUT)
        nlos = LineOfSight.UNDETERMINED if measured.nlos is None else LineOfSight(int(measured.nlos))
        rssi = 0
        if observer.app.rssi_reporting and measured.rssi_dbm is not None:
            rssi = min(max(round(-2 * measured.rssi_dbm), 1), 254)
        return TwoWayMeasurement(mac, Status.OK, nlos, distance_cm, rssi=rssi)

    def _deliver(self, sender: NodeSession, receiver: NodeSession, frames: list[tuple[int, bytes]]) -> list[bytes]:
        out: list[bytes] = []
        for destination, data in frames:
            if sender.app.multi_node_mode is MultiNodeMode.UNICAST and destination != receiver.app.mac_address:
                continue  # with one-to-many every responder hears it, whatever the destination says
            if self.data_loss and self._rng.random() < self.data_loss:
                continue
            arrived = data if self.intercept is None else self.intercept(sender.node.name, receiver.node.name, data)
            if arrived is not None:
                out.append(arrived)
        return out

    def _later(self, session: NodeSession, records: list[TwoWayMeasurement], data: list[bytes]) -> None:
        received = None
        if data or session.node.quirks.empty_data:
            source = session.app.destination_macs[0]
            received = DataReceive(session.handle, Status.OK, source, DATA_SEQUENCE, b"".join(data))
        if self.jitter_ms <= 0:
            session.report(records, received)
            return
        delay_s = self._rng.random() * self.jitter_ms / 1000
        asyncio.get_running_loop().call_later(delay_s, session.report, records, received)


def _failed(mac: int, status: int) -> TwoWayMeasurement:
    return TwoWayMeasurement(mac, status, LineOfSight.UNDETERMINED, INVALID_DISTANCE_CM)


def _same_air(lead: AppConfig, follow: AppConfig) -> bool:
    """Whether the follower's receiver is set to what the leader sends, and they mean each other."""
    return (
        lead.device_role is DeviceRole.INITIATOR
        and follow.device_type is DeviceType.CONTROLEE
        and follow.device_role is DeviceRole.RESPONDER
        and lead.mac_address in follow.destination_macs
        and (
            lead.channel,
            lead.preamble_code,
            lead.sfd_id,
            lead.rframe_config,
            lead.slot_duration_rstu,
            lead.slots_per_round,
            lead.multi_node_mode,
            lead.ranging_usage,
            lead.schedule_mode,
        )
        == (
            follow.channel,
            follow.preamble_code,
            follow.sfd_id,
            follow.rframe_config,
            follow.slot_duration_rstu,
            follow.slots_per_round,
            follow.multi_node_mode,
            follow.ranging_usage,
            follow.schedule_mode,
        )
    )


def _same_key(lead: AppConfig, follow: AppConfig) -> bool:
    return (lead.sts_config, lead.session_key) == (follow.sts_config, follow.session_key)


def _hears_blinks(tag: AppConfig, anchor: AppConfig) -> bool:
    """Whether an anchor listens for this tag's blinks, with its key."""
    return (
        tag.device_role is DeviceRole.UT_TAG
        and anchor.device_role in (DeviceRole.UT_ANCHOR, DeviceRole.UT_SYNCHRONISATION_ANCHOR)
        and anchor.ranging_usage is RangingUsage.UL_TDOA
        and tag.mac_address in anchor.destination_macs
        and (tag.channel, tag.preamble_code, tag.sfd_id, tag.rframe_config)
        == (anchor.channel, anchor.preamble_code, anchor.sfd_id, anchor.rframe_config)
        and _same_key(tag, anchor)
    )


def _parameter(app: AppConfig, identifier: int) -> int:
    """A number among the parameters that have no field of their own; 0 where it is not given."""
    return next((int.from_bytes(value, "little") for known, value in app.extra if known == identifier), 0)
