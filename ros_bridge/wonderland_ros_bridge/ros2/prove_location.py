"""The action *ProveLocation* on the wire: three services and two topics. It follows a drone's proof, and asks for none.

Only the drone can open a session, and only the ledger decides: a goal here is somebody who waits for that. It succeeds
where a committed verdict verified the drone and granted the permission, and aborts otherwise; the result says which.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from wonderland import telemetry
from wonderland.clock import Clock
from wonderland.proofs.records.fields import ACTIONS
from wonderland_rmw_zenoh import wire
from wonderland_rmw_zenoh.interfaces import Interfaces
from wonderland_rmw_zenoh.node import Node

_log = logging.getLogger(__name__)

TYPE: Final = "wonderland_msgs/action/ProveLocation"
WAIT_S: Final = 60.0
MAX_WAIT_S: Final = 3_600.0
GRACE_MS: Final = 30_000
"""After a session's expiry: by then its end is on the ledger, or never will be."""
MAX_GOALS: Final = 50
KEEP_MS: Final = 900_000
"""So long a result can be asked for."""
LOOK_S: Final = 0.25
EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = 2, 3, 4, 5, 6
_UNKNOWN: Final = 0
_NO_SUCH_GOAL: Final = 2
_HAS_ENDED: Final = 3

Message = Mapping[str, Any]


@dataclass(slots=True)
class _Goal:
    id: bytes
    uav_id: str
    action: str
    begun_ms: int
    until_ms: int
    status: int = EXECUTING
    session_id: str = ""
    step: str = ""
    rounds: int = 0
    ended_ms: int = 0
    result: dict[str, Any] = field(default_factory=dict)
    done: asyncio.Event = field(default_factory=asyncio.Event)


class ProveLocation:
    """Goals of a pad's node; it hears of sessions, steps and verdicts from ``PadNode``."""

    def __init__(self, node: Node, types: Interfaces, pad_id: str, clock: Clock) -> None:
        self._node = node
        self._type = types.action(TYPE)
        self._pad_id = pad_id
        self._clock = clock
        self._goals: dict[bytes, _Goal] = {}
        self._changed = asyncio.Event()
        self._feedback: asyncio.Queue[Message] = asyncio.Queue(1_000)

    async def run(self) -> None:
        """Serve until cancelled."""
        name, kind = f"{self._node.name}/prove_location/_action", self._type
        feedback = self._node.advertise(f"{name}/feedback", kind.feedback)
        status = self._node.advertise(f"{name}/status", kind.status, wire.STATE)
        self._node.serve(f"{name}/send_goal", kind.send_goal, self._send_goal)
        self._node.serve(f"{name}/get_result", kind.get_result, self._get_result)
        self._node.serve(f"{name}/cancel_goal", kind.cancel, self._cancel_goal)
        while True:
            self._look()
            while not self._feedback.empty():
                await feedback.publish(self._feedback.get_nowait())
            if self._changed.is_set():
                self._changed.clear()
                await status.publish({"status_list": [_status(each) for each in self._goals.values()]})
            await asyncio.sleep(LOOK_S)

    # --- what the pad tells --------------------------------------------------------------------------------------

    def session(self, message: Message) -> None:
        """A session came to another state on the ledger."""
        for goal in self._open():
            mine = goal.session_id == message["session_id"]
            if not goal.session_id and message["state"] == "requested" and self._fits(goal, message):
                goal.session_id, goal.step = message["session_id"], "request"
                goal.until_ms = message["expires"]["sec"] * 1_000 + GRACE_MS
                self._say(goal)
            elif mine and message["state"] == "cancelled":
                self._end(goal, ABORTED, reason=message["end"] or "cancelled", tx_id=message["tx_id"])

    def decided(self, message: Message) -> None:
        """A verdict was committed."""
        for goal in self._open():
            if goal.session_id != message["session_id"] or not self._fits(goal, message):
                continue
            granted = message["outcome"] == "verified" and message["permission"] == "granted"
            self._end(
                goal,
                SUCCEEDED if granted else ABORTED,
                outcome=message["outcome"],
                permission=message["permission"],
                reason=message["reasons"][0] if message["reasons"] else "",
                tx_id=message["tx_id"],
                block=message["block"],
            )

    def step(self, said: telemetry.Step) -> None:
        """The pad's agent reached a step, by its own word: feedback, and nothing else."""
        for goal in self._open():
            if goal.session_id == said.session_id:
                goal.step = said.step
                self._say(goal)

    def rounds(self, said: telemetry.Estimate) -> None:
        """The pad ranges."""
        for goal in self._open():
            if goal.session_id == said.session_id:
                goal.rounds = said.rounds
                self._say(goal)

    # --- what clients ask ----------------------------------------------------------------------------------------

    async def _send_goal(self, asked: Any) -> Message:
        goal_id, goal, now = bytes(asked.goal_id.uuid), asked.goal, self._clock()
        why_not = ""
        if goal.purpose not in ACTIONS or not 0 < len(goal.uav_id) <= 64:
            why_not = f"purpose {goal.purpose[:20]!r} of drone {goal.uav_id[:64]!r}: name a drone, and {ACTIONS}"
        elif not math.isfinite(goal.wait_s) or not 0 <= goal.wait_s <= MAX_WAIT_S:
            why_not = f"wait_s: 0 to {MAX_WAIT_S:g} seconds"
        elif goal_id in self._goals or sum(1 for _ in self._open()) >= MAX_GOALS:
            why_not = "this goal is known already, or too many are open"
        if why_not:
            _log.warning("a goal is not accepted: %s", why_not)
            return {"accepted": False, "stamp": _stamp(now)}
        until_ms = now + round((goal.wait_s or WAIT_S) * 1_000)
        self._goals[goal_id] = _Goal(goal_id, goal.uav_id, goal.purpose, now, until_ms)
        self._changed.set()
        return {"accepted": True, "stamp": _stamp(now)}

    async def _get_result(self, asked: Any) -> Message:
        goal = self._goals.get(bytes(asked.goal_id.uuid))
        if goal is None:
            return {"status": _UNKNOWN, "result": {"reason": "there is no such goal"}}
        await goal.done.wait()
        return {"status": goal.status, "result": goal.result}

    async def _cancel_goal(self, asked: Any) -> Message:
        goal_id, at = bytes(asked.goal_info.goal_id.uuid), asked.goal_info.stamp
        at_ms = at.sec * 1_000 + at.nanosec // 1_000_000
        if any(goal_id):
            named = self._goals.get(goal_id)
            if named is None:
                return {"return_code": _NO_SUCH_GOAL}
            chosen = [named]
        else:  # all, or those until a time
            chosen = [each for each in self._goals.values() if not at_ms or each.begun_ms <= at_ms]
        chosen = [each for each in chosen if not each.done.is_set()]
        for goal in chosen:
            self._end(goal, CANCELED, reason="cancelled by the client; the drone's session goes on")
        if not chosen and any(goal_id):
            return {"return_code": _HAS_ENDED}
        return {"return_code": 0, "goals_canceling": [_info(each) for each in chosen]}

    # -------------------------------------------------------------------------------------------------------------

    def _look(self) -> None:
        now = self._clock()
        for goal in self._open():
            if now > goal.until_ms:
                self._end(goal, ABORTED, reason="no_verdict" if goal.session_id else "not_requested")
        for goal in [each for each in self._goals.values() if each.done.is_set() and now - each.ended_ms > KEEP_MS]:
            del self._goals[goal.id]
            self._changed.set()

    def _open(self) -> list[_Goal]:
        return [each for each in self._goals.values() if not each.done.is_set()]

    def _fits(self, goal: _Goal, message: Message) -> bool:
        return (goal.uav_id, goal.action) == (message["uav_id"], message["action"])

    def _say(self, goal: _Goal) -> None:
        if not self._feedback.full():
            said = {"session_id": goal.session_id, "step": goal.step, "rounds": goal.rounds}
            self._feedback.put_nowait({"goal_id": _uuid(goal.id), "feedback": said})

    def _end(self, goal: _Goal, status: int, **result: Any) -> None:
        goal.status, goal.ended_ms = status, self._clock()
        goal.result = {"session_id": goal.session_id, **result}
        goal.done.set()
        self._changed.set()


def _uuid(goal_id: bytes) -> Message:
    return {"uuid": list(goal_id)}


def _stamp(t_ms: int) -> Message:
    return {"sec": t_ms // 1_000, "nanosec": t_ms % 1_000 * 1_000_000}


def _info(goal: _Goal) -> Message:
    return {"goal_id": _uuid(goal.id), "stamp": _stamp(goal.begun_ms)}


def _status(goal: _Goal) -> Message:
    return {"goal_info": _info(goal), "status": goal.status}
