"""The pad's nodes, and the tag that the drone carries, in a session for calibrating."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from wonderland.clock import Clock
from wonderland.uwb.agreed import pad_ability
from wonderland.uwb.blinks import BLINK_SLOTS, BlinkPlan, blinks_beside
from wonderland_edge_agent.commissioning.errors import RadioError
from wonderland_edge_agent.commissioning.live.recorder import RunRecorder
from wonderland_edge_agent.radios import AnchorPort
from wonderland_edge_agent.radios.between import COMMON, Common, common_of, ranging_config
from wonderland_fira_uci.errors import RangingPlanError, UwbError
from wonderland_fira_uci.events import FrameStamped, RangeMeasurement, SessionFailed
from wonderland_fira_uci.node import UwbNode
from wonderland_fira_uci.session import UwbSession
from wonderland_fira_uci.uci.airtime import RSTU_PER_MS, measured_ago_ms
from wonderland_fira_uci.uci.config import SessionConfig, least_slots

if TYPE_CHECKING:
    from wonderland.proofs.records.radios import NodeAbility
    from wonderland_edge_agent.settings import PadSettings
    from wonderland_fira_uci.uci.capabilities import Capabilities

READY_S: Final = 10.0
RUN_INTERVAL_MS: Final = 100
MIN_NODES: Final = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class TagPlan:
    """The session of a calibration run: ``macs`` of the pad's nodes by anchor, and what the tag has to be told."""

    macs: Mapping[str, int]
    tag_mac: int
    session_id: int
    key: bytes
    interval_ms: int = RUN_INTERVAL_MS
    common: Common = COMMON
    region: str | None = None
    """Whose channels may be used."""

    def __post_init__(self) -> None:
        """Raises RadioError where a round of all nodes takes longer than the interval."""
        round_ms = self.common.ms(least_slots(len(self.macs)) + BLINK_SLOTS)
        if self.interval_ms < round_ms:
            raise RadioError(
                f"a round of {len(self.macs)} nodes and a blink take {round_ms} ms, and the interval is "
                f"{self.interval_ms} ms: lengthen it"
            )

    def among(self, common: Common) -> TagPlan:
        """The same for nodes that share this, with an interval that their round fits into."""
        round_ms = common.ms(least_slots(len(self.macs)) + BLINK_SLOTS)
        return replace(self, common=common, interval_ms=max(self.interval_ms, round_ms))

    @property
    def measured_ago_ms(self) -> int:
        """How long nodes have measured when they report."""
        return measured_ago_ms(len(self.macs), self.common.slot_us * RSTU_PER_MS // 1_000)

    def blinks(self) -> BlinkPlan:
        """The tag's blinks, which the pad's nodes time-stamp; as ``wonderland uwb listen --blink`` has them."""
        return blinks_beside(
            self.session_id,
            tuple(self.macs.values()),
            self.tag_mac,
            self.key,
            self.interval_ms,
            channel=self.common.channel,
            slot_us=self.common.slot_us,
        )

    def command(self, key_file: Path) -> str:
        """What to run where the tag hangs, if that is another computer."""
        peers = " ".join(f"--peer {mac:04x}" for mac in self.macs.values())
        return (
            f"wonderland uwb listen --port PORT --kind uci --mac {self.tag_mac:04x} {peers} --lead "
            f"--session {self.session_id} --interval-ms {self.interval_ms} --channel {self.common.channel} "
            f"--slot-ms {self.common.slot_us / 1_000:g} --key-file {key_file.name} --blink"
        )


@contextlib.asynccontextmanager
async def open_nodes(ports: Sequence[AnchorPort], clock: Clock) -> AsyncIterator[dict[str, UwbNode]]:
    """The pad's nodes, connected. Raises RadioError where fewer than three answer."""
    async with contextlib.AsyncExitStack() as stack:
        nodes = {}
        for port in ports:
            nodes[port.anchor_id] = await stack.enter_async_context(port.node(clock))
        outcomes = await asyncio.gather(*(node.wait_ready(READY_S) for node in nodes.values()), return_exceptions=True)
        away = {
            name: str(outcome)
            for name, outcome in zip(nodes, outcomes, strict=True)
            if isinstance(outcome, BaseException)
        }
        if len(nodes) - len(away) < MIN_NODES:
            raise RadioError(
                f"fewer than {MIN_NODES} nodes answer: {'; '.join(away.values())}. Are they plugged in, and does no "
                "agent use them?"
            )
        yield nodes


def recorded_ability(pad: PadSettings, said: Mapping[str, Capabilities | None]) -> NodeAbility | None:
    """What the weakest of the pad's nodes can do, for the record, by what each says; None where none of them does.

    Raises RadioError naming the anchor whose node cannot take part in a session at all.
    """
    try:
        return pad_ability(said, pad.uwb.words, pad.uwb.region)
    except RangingPlanError as error:
        raise RadioError(f"these nodes cannot range together: {error}") from error


async def run(
    nodes: Mapping[str, UwbNode], tag: UwbNode | None, plan: TagPlan, recorder: RunRecorder, stop: asyncio.Event
) -> None:
    """Range until ``stop``. Raises RadioError where the nodes, or a tag that hangs here, do not take the session.

    Nodes that know UL-TDoA also time-stamp the tag's blinks; without them the run goes on.
    """
    sessions: list[UwbSession] = []
    readers: list[asyncio.Task[None]] = []
    stampers: list[asyncio.Task[None]] = []
    try:
        if tag is not None:
            plan = await _together(plan, nodes, tag)
        for name, node in nodes.items():
            try:
                session = await node.open_session(_config(plan, plan.macs[name], (plan.tag_mac,), leads=False))
            except UwbError as error:
                raise RadioError(f"anchor {name} does not take the session: {error}") from error
            sessions.append(session)
            readers.append(asyncio.create_task(_read(session, name, plan.tag_mac, recorder)))
        if tag is not None:
            try:
                sessions.append(
                    await tag.open_session(_config(plan, plan.tag_mac, tuple(plan.macs.values()), leads=True))
                )
            except UwbError as error:
                raise RadioError(f"the tag does not range: {error}") from error
        stampers = await _listen_to_blinks(nodes, tag, plan, recorder, sessions)
        waiting = asyncio.create_task(stop.wait())
        done, _ = await asyncio.wait([waiting, *readers], return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        for task in done:
            if task is not waiting:
                task.result()
    finally:
        for reader in (*readers, *stampers):
            reader.cancel()
        await asyncio.gather(*readers, *stampers, return_exceptions=True)
        await asyncio.gather(*(session.close() for session in sessions))


async def _together(plan: TagPlan, nodes: Mapping[str, UwbNode], tag: UwbNode) -> TagPlan:
    """The plan with what the tag shares with the pad's nodes. Raises RadioError where it is away, or shares nothing."""
    try:
        await tag.wait_ready(READY_S)
    except UwbError as error:
        raise RadioError(f"the tag does not range: {error}") from error
    return plan.among(common_to([*nodes.values(), tag], plan.region))


def common_to(nodes: Iterable[UwbNode], region: str | None) -> Common:
    """What all these share. Raises RadioError where no channel that may be used."""
    common = common_of([node.capabilities for node in nodes], region)
    if common is None:
        place = f" that region {region} has (pad.toml, uwb.region)" if region else ""
        raise RadioError(f"these nodes share no channel{place}")
    return common


async def _listen_to_blinks(
    nodes: Mapping[str, UwbNode],
    tag: UwbNode | None,
    plan: TagPlan,
    recorder: RunRecorder,
    sessions: list[UwbSession],
) -> list[asyncio.Task[None]]:
    """Whoever reads the time stamps; nobody where a node does not take the session."""
    blinks = plan.blinks()
    opened: list[tuple[str, UwbSession]] = []
    try:
        for name, node in nodes.items():
            index = blinks.pad_macs.index(plan.macs[name])
            opened.append((name, await node.open_session(blinks.pad_anchor(index))))
        if tag is not None:
            opened.append(("", await tag.open_session(blinks.uav_tag())))
    except UwbError as error:
        recorder.no_stamps = str(error)
        await asyncio.gather(*(session.close() for _, session in opened))
        return []
    sessions.extend(session for _, session in opened)
    return [
        asyncio.create_task(_read_stamps(session, name, plan.tag_mac, recorder)) for name, session in opened if name
    ]


async def _read(session: UwbSession, name: str, tag_mac: int, recorder: RunRecorder) -> None:
    async for event in session.events():
        if isinstance(event, RangeMeasurement) and event.peer_mac == tag_mac:
            recorder.range(name, event.t_ms, event.range_mm, nlos=bool(event.nlos))
        elif isinstance(event, SessionFailed):
            raise RadioError(f"anchor {name}: {event.error}")


async def _read_stamps(session: UwbSession, name: str, tag_mac: int, recorder: RunRecorder) -> None:
    async for event in session.events():
        if isinstance(event, FrameStamped) and event.tag_mac == tag_mac:
            recorder.stamp(name, event.t_ms, event.number, event.ticks)
        elif isinstance(event, SessionFailed):
            recorder.no_stamps = f"anchor {name}: {event.error}"
            return


def _config(plan: TagPlan, mac: int, peers: tuple[int, ...], *, leads: bool) -> SessionConfig:
    slots = least_slots(len(plan.macs))
    return ranging_config(
        mac,
        peers,
        leads=leads,
        session_id=plan.session_id,
        key=plan.key,
        interval_ms=plan.interval_ms,
        slots=slots,
        common=plan.common,
    )
