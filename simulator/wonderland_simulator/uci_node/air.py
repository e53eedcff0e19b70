"""The air between virtual nodes: who hears whom, in rounds, and what they measure.

A round is led by the session's controller, at its interval or on the time base of another session of its node. The
channel itself (geometry, noise, obstruction, attackers at the physical layer) is the caller's ``measure``. Blinks
(UL-TDoA) are led by the tag and go one way: what each anchor's clock shows when it hears one is the caller's ``stamp``.

Each node has one half-duplex radio: from a round's first slot to its last it does nothing else, and who is busy with
another session is not there. Data rides in SP1 frames only: the initiator's reach all responders, and theirs reach it
where their node can do so. Frames of foreign groups on the same channel and preamble code drown each other
(``interference``).
"""

from __future__ import annotations

import asyncio
import random
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

from wonderland_fira_uci.uci.airtime import RSTU_PER_MS
from wonderland_fira_uci.uci.config import (
    AppConfig,
    DeviceType,
    MultiNodeMode,
    ParameterId,
    RangingUsage,
    least_slots,
    slots_to_middle,
)
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
from wonderland_simulator.uci_node.interference import Frame, Reach, frames_of, pair_frames, survives
from wonderland_simulator.uci_node.matching import failed, hears_blinks, parameter_of, same_air, same_key

if TYPE_CHECKING:
    from wonderland_simulator.uci_node.node import VirtualNode
    from wonderland_simulator.uci_node.session import NodeSession

_SLACK_S: Final = 1e-6
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
    begun_s: float = -1.0
    """When its last round began."""
    blinks: int = 0


class Air:
    """Joins virtual nodes of one process and one event loop.

    ``data_loss``: probability that a data frame is not heard by a responder. ``jitter_ms``: reports of one round reach
    the ports up to that much after its end, each on its own. ``clock_s``: what ``measure`` is asked about. Without
    ``stamp`` no nodes share a clock, and blinks are not heard. ``reach``: how far nodes are apart, for frames of
    foreign groups; without it all are equally near.
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
        reach: Reach | None = None,
    ) -> None:
        self.measure = measure
        self.data_loss = data_loss
        self.jitter_ms = jitter_ms
        self.intercept = intercept
        self.stamp = stamp
        self.reach = reach
        self.rounds = 0
        self.collisions = 0
        """How often a node was wanted in a round while its radio was busy with another session."""
        self.drowned = 0
        """How often a pair lost a round to frames of a foreign group."""
        self._rng = rng
        self._clock_s = clock_s
        self._groups: dict[int, _Group] = {}
        self._busy: dict[VirtualNode, tuple[float, int]] = {}
        """Until when (the loop's time, s) a node's radio is busy, and with which session."""

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
        if self._busy.get(session.node, (0.0, 0))[1] == session.session_id:
            del self._busy[session.node]
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
        """The next round: one interval later, or with those whose time it follows."""
        if group.timer is not None:
            group.timer.cancel()
            group.timer = None
        pace = self._leader(group) or group.members[0]
        if pace.time_base is not None:
            return  # ``_followed`` does
        loop = asyncio.get_running_loop()
        group.due_s = from_s + pace.app.interval_ms / 1000 * (1 + pace.node.drift)
        if group.due_s < loop.time() - 1:  # the process was stopped for a while: no rounds to catch up
            group.due_s = loop.time()
        group.timer = loop.call_at(group.due_s, self._round, session_id)

    def _followed(self, leading_id: int, due_s: float) -> None:
        """Rounds of sessions that follow this one's: so much after it began."""
        for session_id, group in self._groups.items():
            leader = self._leader(group)
            base = None if leader is None else leader.time_base
            if leader is None or base is None or base[0] != leading_id:
                continue
            group.due_s = due_s + base[1] / 1e6
            window_ms = parameter_of(leader.app, ParameterId.UL_TDOA_RANDOM_WINDOW)
            if window_ms:
                group.due_s += self._rng.random() * window_ms / 1000
            if group.timer is not None:
                group.timer.cancel()
            group.timer = asyncio.get_running_loop().call_at(group.due_s, self._round, session_id)

    def _free(self, session: NodeSession, from_s: float, until_s: float) -> bool:
        """Whether the node's radio can take part in a round; it is busy with it then."""
        if not session.node.quirks.one_radio:
            return True
        busy_s, other = self._busy.get(session.node, (0.0, 0))
        if other != session.session_id and from_s < busy_s - _SLACK_S:
            self.collisions += 1
            return False
        self._busy[session.node] = (until_s, session.session_id)
        return True

    def _round(self, session_id: int) -> None:
        group = self._groups[session_id]
        begun_s = group.begun_s = group.due_s
        self._schedule(session_id, group, begun_s)
        self._followed(session_id, begun_s)
        self.rounds += 1
        leader = self._leader(group)
        if leader is None:
            for session in group.members:
                self._later(session, begun_s, [], [])
            return
        if leader.app.ranging_usage is RangingUsage.UL_TDOA:
            self._blink(group, leader, begun_s)
        else:
            middle = slots_to_middle(len(leader.app.destination_macs), leader.app.round_control)
            middle_s = begun_s + middle * leader.app.slot_duration_rstu / RSTU_PER_MS / 1000
            asyncio.get_running_loop().call_at(middle_s, self._range, session_id, begun_s)

    def _range(self, session_id: int, begun_s: float) -> None:
        """One round of two-way ranging, with the data that rides in it, at the middle of its measurement."""
        group = self._groups.get(session_id)
        leader = None if group is None else self._leader(group)
        if group is None or leader is None:
            return
        t_s = self._clock_s()
        app = leader.app
        slots = least_slots(len(app.destination_macs), app.round_control)
        until_s = begun_s + slots * app.slot_duration_rstu / RSTU_PER_MS / 1000
        there = self._free(leader, begun_s, until_s)
        carries = leader.carries_data
        frames = leader.take_data() if there and carries else []
        followers = [self._follower(group, leader, mac) for mac in app.destination_macs]
        on_air = frames_of(app, leader.node.name, [_name(each) for each in followers], begun_s)
        foreign = self._foreign(group, app, begun_s, until_s)
        led: list[TwoWayMeasurement] = []
        back: list[tuple[int, bytes]] = []
        for index, (mac, follower) in enumerate(zip(app.destination_macs, followers, strict=True)):
            if follower is None or not there or not self._free(follower, begun_s, until_s):
                led.append(failed(mac, Status.RANGING_RX_TIMEOUT))
                continue
            if not same_air(app, follower.app):
                led.append(failed(mac, Status.RANGING_RX_TIMEOUT))
                continue
            if self._drowns(pair_frames(on_air, index), leader, follower, foreign):
                led.append(failed(mac, Status.RANGING_RX_TIMEOUT))
                self._later(follower, until_s, [failed(app.mac_address, Status.RANGING_RX_TIMEOUT)], [])
                continue
            keyed = same_key(app, follower.app) or not follower.node.quirks.checks_keys
            status = Status.OK if keyed else Status.RANGING_RX_PHY_STS_FAILED
            if status is not Status.OK:
                led.append(failed(mac, status))
                self._later(follower, until_s, [failed(app.mac_address, status)], [])
                continue
            led.append(self._record(leader, follower, t_s))
            answer = self._record(follower, leader, t_s)
            through = led[-1].status == Status.OK and answer.status == Status.OK
            if through and carries and follower.node.quirks.responder_data:
                back.extend((mac, data) for data in self._deliver(follower, leader, follower.take_data()))
            heard = self._deliver(leader, follower, frames) if through else []
            self._later(follower, until_s, [answer], [(app.mac_address, data) for data in heard])
        for session in group.members:
            if session is not leader and session.app.mac_address not in app.destination_macs:
                self._later(session, until_s, [], [])
        self._rng.shuffle(led)
        self._later(leader, until_s, led, back)

    def _blink(self, group: _Group, tag: NodeSession, begun_s: float) -> None:
        """One frame of a tag, time-stamped by whoever listens with the same key."""
        t_s = self._clock_s()
        until_s = begun_s + tag.app.slot_duration_rstu / RSTU_PER_MS / 1000
        if not self._free(tag, begun_s, until_s):
            return
        for _, data in tag.take_data():
            tag.blink_payload = data
        group.blinks += 1
        on_air = frames_of(tag.app, tag.node.name, [], begun_s)
        foreign = self._foreign(group, tag.app, begun_s, until_s)
        for anchor in group.members:
            if anchor is tag or self.stamp is None or not hears_blinks(tag.app, anchor.app):
                continue
            ticks = self.stamp(anchor.node.name, tag.node.name, t_s)
            if ticks is None or not self._free(anchor, begun_s, until_s):
                continue
            if self._drowns(on_air, tag, anchor, foreign):
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
            self._report(until_s, anchor.report_blink, (record,))

    @staticmethod
    def _follower(group: _Group, leader: NodeSession, mac: int) -> NodeSession | None:
        return next((s for s in group.members if s is not leader and s.app.mac_address == mac), None)

    def _foreign(self, group: _Group, app: AppConfig, from_s: float, until_s: float) -> list[Frame]:
        """Frames of other groups on the same channel and code that lie within a round; the next ones are known, too."""
        ours = {session.node for session in group.members}
        out: list[Frame] = []
        for other in self._groups.values():
            leader = self._leader(other)
            if leader is None or not ours.isdisjoint(session.node for session in other.members):
                continue
            if (leader.app.channel, leader.app.preamble_code) != (app.channel, app.preamble_code):
                continue
            names = [_name(self._follower(other, leader, mac)) for mac in leader.app.destination_macs]
            for begun_s in {other.begun_s, other.due_s}:
                frames = frames_of(leader.app, leader.node.name, names, begun_s)
                out += [f for f in frames if f.sender and f.from_s < until_s and from_s < f.until_s]
        return out

    def _drowns(
        self, frames: Iterable[Frame], leader: NodeSession, follower: NodeSession, foreign: list[Frame]
    ) -> bool:
        """Whether a pair loses any of the frames that it needs."""
        if not foreign:
            return False
        for frame in frames:
            receiver = follower if frame.responder is None else leader
            if not survives(frame, receiver.node.name, foreign, self.reach, self._rng):
                self.drowned += 1
                return True
        return False

    def _record(self, observer: NodeSession, peer: NodeSession, t_s: float) -> TwoWayMeasurement:
        measured = self.measure(observer.node.name, peer.node.name, t_s)
        mac = peer.app.mac_address
        if measured.range_mm is None or measured.status != Status.OK:
            return failed(mac, measured.status or Status.RANGING_RX_TIMEOUT)
        quirks = observer.node.quirks
        if measured.range_mm < 0 and quirks.tells_negative:
            return failed(mac, Status.NEGATIVE_DISTANCE)
        distance_cm = max((measured.range_mm + (0 if quirks.cuts_to_cm else 5)) // 10, 0)
        if distance_cm >= INVALID_DISTANCE_CM:
            return failed(mac, Status.RANGING_RX_TIMEOUT)
        unsure = measured.nlos is None or not quirks.tells_nlos
        nlos = LineOfSight.UNDETERMINED if unsure else LineOfSight(int(bool(measured.nlos)))
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

    def _later(
        self,
        session: NodeSession,
        over_s: float,
        records: list[TwoWayMeasurement],
        data: list[tuple[int, bytes]],
    ) -> None:
        """What a node reports of a round, once it is over. ``data``: (source, octets), in the order of their frames."""
        by_source: dict[int, bytes] = {}
        for source, octets in data:
            by_source[source] = by_source.get(source, b"") + octets
        if not by_source and session.node.quirks.empty_data:
            by_source[session.app.destination_macs[0]] = b""
        received = [
            DataReceive(session.handle, Status.OK, source, DATA_SEQUENCE, octets)
            for source, octets in by_source.items()
        ]
        self._report(over_s, session.report, records, received)

    def _report(self, over_s: float, report: Callable[..., None], *what: object) -> None:
        """At a port, after the round was over (the loop's time, s)."""
        delay_s = max(self.jitter_ms, 0.0) / 1000 * self._rng.random()
        asyncio.get_running_loop().call_at(over_s + delay_s, report, *what)


def _name(session: NodeSession | None) -> str:
    """Of its node; nothing where nobody is."""
    return "" if session is None else session.node.name
