"""An action server: the three services and two topics that an action of ROS 2 is made of.

What a goal asks for, and when it has ended, others say (``accept``, ``end``); here is who asked, and who is told.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Generic, TypeVar

from wonderland_rmw_zenoh import wire
from wonderland_rmw_zenoh.interfaces import ActionType
from wonderland_rmw_zenoh.node import Node

_log = logging.getLogger(__name__)

MAX_GOALS: Final = 50
KEEP_MS: Final = 900_000
"""So long a result can be asked for."""
MAX_KEPT: Final = 1_000
"""More than that, the oldest that has ended is forgotten earlier."""
LOOK_S: Final = 0.25
MAX_FEEDBACK: Final = 1_000
EXECUTING, SUCCEEDED, CANCELED, ABORTED = 2, 4, 5, 6
_UNKNOWN: Final = 0
_NO_SUCH_GOAL: Final = 2
_HAS_ENDED: Final = 3

Message = Mapping[str, Any]
T = TypeVar("T")


class GoalRefusedError(Exception):
    """A goal that is not accepted; the text says why."""


@dataclass(slots=True)
class Goal(Generic[T]):
    """A goal that was accepted; ``own`` is what its server keeps of it."""

    id: bytes
    own: T
    begun_ms: int
    status: int = EXECUTING
    ended_ms: int = 0
    result: Message = field(default_factory=dict)
    done: asyncio.Event = field(default_factory=asyncio.Event)


class ActionServer(Generic[T]):
    """``accept`` makes what is kept of a goal, or raises GoalRefusedError; ``cancel`` is the result of one taken back.

    Results have a text ``reason``.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        kind: ActionType,
        clock: Callable[[], int],
        accept: Callable[[Any], T],
        cancel: Callable[[Goal[T]], Message],
    ) -> None:
        self._node = node
        self._name = name
        self._type = kind
        self._clock = clock
        self._accept = accept
        self._cancel = cancel
        self._goals: dict[bytes, Goal[T]] = {}
        self._changed = asyncio.Event()
        self._feedback: asyncio.Queue[Message] = asyncio.Queue(MAX_FEEDBACK)

    async def run(self, look: Callable[[int], None] | None = None) -> None:
        """Serve until cancelled; ``look`` is called each quarter of a second."""
        name, kind = f"{self._name}/_action", self._type
        feedback = self._node.advertise(f"{name}/feedback", kind.feedback)
        status = self._node.advertise(f"{name}/status", kind.status, wire.STATE)
        self._node.serve(f"{name}/send_goal", kind.send_goal, self._send_goal)
        self._node.serve(f"{name}/get_result", kind.get_result, self._get_result)
        self._node.serve(f"{name}/cancel_goal", kind.cancel, self._cancel_goal)
        while True:
            if look is not None:
                look(self._clock())
            self._forget()
            while not self._feedback.empty():
                await feedback.publish(self._feedback.get_nowait())
            if self._changed.is_set():
                self._changed.clear()
                await status.publish({"status_list": [_status(each) for each in self._goals.values()]})
            await asyncio.sleep(LOOK_S)

    def open(self) -> list[Goal[T]]:
        """Those that have not ended."""
        return [each for each in self._goals.values() if not each.done.is_set()]

    def say(self, goal: Goal[T], feedback: Message) -> None:
        """Feedback to whoever listens; where too much waits it is left out."""
        if not self._feedback.full():
            self._feedback.put_nowait({"goal_id": _uuid(goal.id), "feedback": feedback})

    def end(self, goal: Goal[T], status: int, result: Message) -> None:
        """End a goal; one that has ended stays as it is."""
        if goal.done.is_set():
            return
        goal.status, goal.ended_ms, goal.result = status, self._clock(), result
        goal.done.set()
        self._changed.set()

    async def _send_goal(self, asked: Any) -> Message:
        goal_id, now = bytes(asked.goal_id.uuid), self._clock()
        try:
            own = self._own(goal_id, asked.goal)
        except GoalRefusedError as why:
            _log.warning("%s: a goal is not accepted: %s", self._name, why)
            return {"accepted": False, "stamp": _stamp(now)}
        self._goals[goal_id] = Goal(goal_id, own, now)
        if len(self._goals) > MAX_KEPT:
            del self._goals[next(each.id for each in self._goals.values() if each.done.is_set())]
        self._changed.set()
        return {"accepted": True, "stamp": _stamp(now)}

    def _own(self, goal_id: bytes, goal: Any) -> T:
        if goal_id in self._goals or len(self.open()) >= MAX_GOALS:
            raise GoalRefusedError("this goal is known already, or too many are open")
        return self._accept(goal)

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
        if not chosen and any(goal_id):
            return {"return_code": _HAS_ENDED}
        for goal in chosen:
            self.end(goal, CANCELED, self._cancel(goal))
        return {"return_code": 0, "goals_canceling": [_info(each) for each in chosen]}

    def _forget(self) -> None:
        now = self._clock()
        for goal in [each for each in self._goals.values() if each.done.is_set() and now - each.ended_ms > KEEP_MS]:
            del self._goals[goal.id]
            self._changed.set()


def _uuid(goal_id: bytes) -> Message:
    return {"uuid": list(goal_id)}


def _stamp(t_ms: int) -> Message:
    return {"sec": t_ms // 1_000, "nanosec": t_ms % 1_000 * 1_000_000}


def _info(goal: Goal[T]) -> Message:
    return {"goal_id": _uuid(goal.id), "stamp": _stamp(goal.begun_ms)}


def _status(goal: Goal[T]) -> Message:
    return {"goal_info": _info(goal), "status": goal.status}
