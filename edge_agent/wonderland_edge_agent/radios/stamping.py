"""Session C: every node that can time-stamps the drone's blinks."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence
from typing import Any

from wonderland.uwb.blinks import BlinkPlan
from wonderland_edge_agent.radios.anchors import READY_GRACE_S, Sink
from wonderland_edge_agent.session.events import FrameHeard
from wonderland_fira_uci.errors import UwbError
from wonderland_fira_uci.events import FrameStamped, SessionFailed
from wonderland_fira_uci.node import UwbNode
from wonderland_fira_uci.session import UwbSession
from wonderland_fira_uci.uci.config import SessionConfig

_log = logging.getLogger(__name__)

Starter = Callable[[UwbNode, SessionConfig], Awaitable[UwbSession]]
Keeper = Callable[[Coroutine[Any, Any, None]], None]


class BlinkStamps:
    """Opens the sessions on a pad's ``nodes`` (by anchor); ``start`` and ``keep`` are of who closes them again."""

    def __init__(self, nodes: Mapping[str, UwbNode], start: Starter, keep: Keeper) -> None:
        """``start`` opens a session on a node; ``keep`` runs a reader until the sessions are closed."""
        self._nodes = nodes
        self._start = start
        self._keep = keep

    async def open(self, plan: BlinkPlan, anchor_ids: Sequence[str], sink: Sink) -> int:
        """On every node that can; returns how many. Without any the proof has no time differences."""
        outcomes = await asyncio.gather(
            *(self._open_anchor(plan, index, anchor_id, sink) for index, anchor_id in enumerate(anchor_ids))
        )
        missing = [f"{anchor_id} ({why})" for anchor_id, why in zip(anchor_ids, outcomes, strict=True) if why]
        if missing:
            _log.warning("session %#010x: no time stamps from %s", plan.session_id, ", ".join(missing))
        return len(anchor_ids) - len(missing)

    async def _open_anchor(self, plan: BlinkPlan, index: int, anchor_id: str, sink: Sink) -> str:
        """Why this anchor stamps nothing; empty where it does."""
        node = self._nodes.get(anchor_id)
        if node is None:
            return "no port configured"
        try:
            await node.wait_ready(READY_GRACE_S)
            session = await self._start(node, plan.pad_anchor(index))
        except UwbError as error:
            return str(error)
        self._keep(_stamps(session, anchor_id, plan.uav_mac, sink))
        return ""


async def _stamps(session: UwbSession, anchor_id: str, uav_mac: int, sink: Sink) -> None:
    async for event in session.events():
        match event:
            case FrameStamped() if event.tag_mac == uav_mac:
                sink(FrameHeard(anchor_id, event.t_ms, event.number, event.ticks, event.payload))
            case SessionFailed():
                _log.warning("anchor %s: no time stamps any more: %s", anchor_id, event.error)
            case _:
                pass
