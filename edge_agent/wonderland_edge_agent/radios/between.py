"""Ranges between a pad's own nodes: each leads once and ranges all others. No drone takes part."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from wonderland.uwb.agreed import ASSUMED
from wonderland.uwb.needs import MAX_SLOT_US, PREFERRED_CHANNEL, channel_among, slot_us
from wonderland_fira_uci.errors import UwbError
from wonderland_fira_uci.events import RangeMeasurement, SessionFailed
from wonderland_fira_uci.node import UwbNode
from wonderland_fira_uci.session import UwbSession
from wonderland_fira_uci.uci.airtime import RSTU_PER_MS
from wonderland_fira_uci.uci.capabilities import Capabilities
from wonderland_fira_uci.uci.config import AppConfig, DeviceRole, DeviceType, MultiNodeMode, SessionConfig
from wonderland_fira_uci.uci.status import SessionType, Status, status_name

if TYPE_CHECKING:
    from wonderland.proofs.records.pads import Commissioning

_log = logging.getLogger(__name__)

INTERVAL_MS: Final = 50
SLOTS: Final = 20
"""Of 2 ms: one round of eight followers fits into the interval."""
PATIENCE: Final = 4
"""A leader gets this many times the time that its rounds should take."""
LEAST_S: Final = 2.0
ROLL_CALL_ROUNDS: Final = 2
ROLL_CALL_S: Final = 0.6
ROLL_CALL_LEADERS: Final = 3
"""So many lead at most until everybody was heard: two may fail, and one is still contradicted."""


@dataclass(frozen=True, slots=True)
class Common:
    """What nodes share that range each other without a session's plan: a channel, and slots that all keep up with."""

    channel: int = PREFERRED_CHANNEL
    slot_us: int = 2_000

    def ms(self, slots: int) -> int:
        """How long so many slots take."""
        return -(-slots * self.slot_us // 1_000)


COMMON: Final = Common()
"""Of nodes that say nothing."""

PairRanges = dict[tuple[str, str], list[int]]
"""Ranges in mm by (leader, follower)."""


def channel_of(commissioning: Commissioning | None) -> int:
    """The channel of this pad's sessions, by its record, with a drone that has all."""
    nodes = ASSUMED if commissioning is None or commissioning.nodes is None else commissioning.nodes
    return channel_among(nodes.channels) or PREFERRED_CHANNEL


def ranging_config(
    mac: int,
    peers: Sequence[int],
    *,
    leads: bool,
    session_id: int,
    key: bytes,
    interval_ms: int = INTERVAL_MS,
    slots: int = SLOTS,
    common: Common = COMMON,
) -> SessionConfig:
    """One node's part in a session of one controller and several controlees. Raises UciEncodeError."""
    app = AppConfig(
        device_type=DeviceType.CONTROLLER if leads else DeviceType.CONTROLEE,
        device_role=DeviceRole.INITIATOR if leads else DeviceRole.RESPONDER,
        multi_node_mode=MultiNodeMode.ONE_TO_MANY,
        mac_address=mac,
        destination_macs=tuple(peers),
        interval_ms=max(interval_ms, common.ms(slots)),
        slots_per_round=slots,
        slot_duration_rstu=common.slot_us * RSTU_PER_MS // 1_000,
        channel=common.channel,
        rssi_reporting=1,
        session_key=key,
    )
    return SessionConfig(session_id=session_id, app=app, session_type=SessionType.RANGING)


async def measure_between(
    nodes: Mapping[str, UwbNode],
    macs: Mapping[str, int],
    *,
    rounds: int = 20,
    random_octets: Callable[[int], bytes] = secrets.token_bytes,
    told: Callable[[str], None] = lambda _: None,
    channel: int = PREFERRED_CHANNEL,
    region: str | None = None,
) -> PairRanges:
    """Let every node that is ready lead ``rounds`` rounds. ``told`` hears which anchor leads. Pairs may be missing.

    Never raises for a node that is away or refuses: what it would have measured is missing then.
    """
    out: PairRanges = {}
    troubles: dict[str, str] = {}
    present = [name for name, node in nodes.items() if node.is_ready and name in macs]
    if len(present) < 2:
        return out
    common = common_of([nodes[name].capabilities for name in present], region, channel)
    if common is None:
        return out
    for leader in present:
        told(leader)
        others = [name for name in present if name != leader]
        limit_s = max(PATIENCE * rounds * max(INTERVAL_MS, common.ms(SLOTS)) / 1000, LEAST_S)
        led = await _lead(nodes, macs, leader, others, rounds, limit_s, random_octets, common)
        out |= led.ranges
        troubles |= led.refusals
    for name, trouble in troubles.items():
        _log.warning("anchor %s: no ranges between anchors: %s", name, trouble)
    return out


@dataclass(frozen=True, slots=True)
class RollCall:
    """Which nodes another one ranged, and which none did, with the reason. Both empty: there was nobody to ask."""

    heard: frozenset[str] = frozenset()
    unheard: Mapping[str, str] = field(default_factory=dict)
    refused: frozenset[str] = frozenset()
    """Of the unheard: nodes that take no ranging session, wherever the others stand."""


async def roll_call(
    nodes: Mapping[str, UwbNode],
    macs: Mapping[str, int],
    *,
    random_octets: Callable[[int], bytes] = secrets.token_bytes,
    channel: int = PREFERRED_CHANNEL,
    region: str | None = None,
) -> RollCall:
    """A short look whether all nodes that answer also range: one leads, and others where it does not hear all."""
    present = [name for name, node in nodes.items() if node.is_ready and name in macs]
    common = common_of([nodes[name].capabilities for name in present], region, channel)
    if common is None:
        return RollCall()
    limit_s = max(ROLL_CALL_S, ROLL_CALL_S * common.ms(SLOTS) / INTERVAL_MS)
    heard: set[str] = set()
    why: dict[str, str] = {}
    refused: dict[str, str] = {}
    leaders: list[str] = []
    while len(leaders) < min(ROLL_CALL_LEADERS, len(present)) and len(heard) < len(present) and len(present) > 2:
        # Whoever was heard is fit to lead; a leader that hears nobody may be the one that is at fault.
        leader = min((name for name in present if name not in leaders), key=lambda name: name not in heard)
        leaders.append(leader)
        followers = [name for name in present if name != leader]
        led = await _lead(nodes, macs, leader, followers, ROLL_CALL_ROUNDS, limit_s, random_octets, common)
        heard |= {name for pair in led.ranges for name in pair} | led.negative
        refused |= led.refusals
        for name, trouble in led.unmeasured.items():
            why.setdefault(name, trouble)
    if not leaders:
        return RollCall()
    why |= refused
    unheard = {name: why.get(name, "no other anchor hears it") for name in present if name not in heard}
    return RollCall(frozenset(heard), unheard, frozenset(unheard) & frozenset(refused))


def common_of(
    said: Sequence[Capabilities | None], region: str | None = None, channel: int = PREFERRED_CHANNEL
) -> Common | None:
    """What these nodes share, by what they say: ``channel`` where all have it, another one where not.

    None, and a line in the log, where they have none together that may be used in ``region``.
    """
    told = [each for each in said if each is not None]
    channels = [each.channels for each in told]
    found = channel_among((channel,), *channels, region=region) or channel_among(*channels, region=region)
    if found is None:
        place = f" that region {region} has" if region else ""
        _log.warning("no ranging of these nodes: they share no channel%s", place)
        return None
    return Common(found, min(max(COMMON.slot_us, *(slot_us(each) for each in told), 0), MAX_SLOT_US))


@dataclass(slots=True)
class _Led:
    """What one leader measured, and what was wrong with the others."""

    ranges: PairRanges = field(default_factory=dict)
    refusals: dict[str, str] = field(default_factory=dict)
    """Nodes that did not take the session, or fell out of it."""
    unmeasured: dict[str, str] = field(default_factory=dict)
    """Followers to which a measurement failed."""
    negative: set[str] = field(default_factory=set)
    """Ranges below zero, of nodes close to each other whose antenna delay nobody has set: they range all the same."""


async def _lead(
    nodes: Mapping[str, UwbNode],
    macs: Mapping[str, int],
    leader: str,
    followers: Sequence[str],
    rounds: int,
    limit_s: float,
    random_octets: Callable[[int], bytes],
    common: Common,
) -> _Led:
    session_id = int.from_bytes(random_octets(4), "little") | 1
    key = random_octets(16)
    names = {macs[name]: name for name in followers}
    found: PairRanges = {(leader, name): [] for name in followers}
    led = _Led()
    sessions: list[UwbSession] = []

    async def opened(name: str, peers: Sequence[int], *, leads: bool) -> UwbSession | None:
        try:
            config = ranging_config(macs[name], peers, leads=leads, session_id=session_id, key=key, common=common)
            session = await nodes[name].open_session(config)
        except UwbError as error:
            led.refusals[name] = f"takes no ranging session: {error}"
            return None
        sessions.append(session)
        return session

    try:
        await asyncio.gather(*(opened(name, (macs[leader],), leads=False) for name in followers))
        leading = await opened(leader, tuple(names), leads=True)
        if leading is None:
            return led
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(limit_s):
                await _collect(leading, names, leader, found, rounds, led)
    finally:
        await asyncio.gather(*(session.close() for session in sessions))
    led.ranges = {pair: values for pair, values in found.items() if values}
    return led


async def _collect(
    session: UwbSession,
    names: Mapping[int, str],
    leader: str,
    found: PairRanges,
    rounds: int,
    led: _Led,
) -> None:
    async for event in session.events():
        if isinstance(event, RangeMeasurement) and event.peer_mac in names:
            name = names[event.peer_mac]
            if event.range_mm:
                found[leader, name].append(event.range_mm)
                if all(len(values) >= rounds for values in found.values()):
                    return
            elif event.status == Status.NEGATIVE_DISTANCE:
                led.negative |= {leader, name}
            elif event.status != Status.OK:
                led.unmeasured.setdefault(name, f"no other anchor hears it: {status_name(event.status)}")
        elif isinstance(event, SessionFailed):
            led.refusals[leader] = f"falls out of a ranging session: {event.error}"
            return
