"""The action *ProveLocation* of a pad's node: it follows a drone's proof, and asks for none.

Only the drone can open a session, and only the ledger decides: a goal here is somebody who waits for that. It succeeds
where a committed verdict verified the drone and granted the permission, and aborts otherwise; the result says which.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from wonderland import telemetry
from wonderland.clock import Clock
from wonderland.proofs.records.fields import ACTIONS
from wonderland_rmw_zenoh.actions import ABORTED, SUCCEEDED, ActionServer, Goal, GoalRefusedError
from wonderland_rmw_zenoh.interfaces import Interfaces
from wonderland_rmw_zenoh.node import Node

TYPE: Final = "wonderland_msgs/action/ProveLocation"
WAIT_S: Final = 60.0
MAX_WAIT_S: Final = 3_600.0
GRACE_MS: Final = 30_000
"""After a session's expiry: by then its end is on the ledger, or never will be."""

Message = Mapping[str, Any]


@dataclass(slots=True)
class _Followed:
    uav_id: str
    action: str
    until_ms: int
    session_id: str = ""
    step: str = ""
    rounds: int = 0


class ProveLocation:
    """Goals of a pad's node; it hears of sessions, steps and verdicts from ``PadNode``."""

    def __init__(self, node: Node, types: Interfaces, pad_id: str, clock: Clock) -> None:
        self._pad_id = pad_id
        self._clock = clock
        self._server: ActionServer[_Followed] = ActionServer(
            node, f"{node.name}/prove_location", types.action(TYPE), clock, self._accept, _cancelled
        )

    async def run(self) -> None:
        """Serve until cancelled."""
        await self._server.run(self._look)

    # --- what the pad tells --------------------------------------------------------------------------------------

    def session(self, message: Message) -> None:
        """A session came to another state on the ledger."""
        for goal in self._server.open():
            own = goal.own
            mine = own.session_id == message["session_id"]
            if not own.session_id and message["state"] == "requested" and _fits(own, message):
                own.session_id, own.step = message["session_id"], "request"
                own.until_ms = message["expires"]["sec"] * 1_000 + GRACE_MS
                self._say(goal)
            elif mine and message["state"] == "cancelled":
                self._end(goal, ABORTED, reason=message["end"] or "cancelled", tx_id=message["tx_id"])

    def decided(self, message: Message) -> None:
        """A verdict was committed."""
        for goal in self._server.open():
            if goal.own.session_id != message["session_id"] or not _fits(goal.own, message):
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
        for goal in self._server.open():
            if goal.own.session_id == said.session_id:
                goal.own.step = said.step
                self._say(goal)

    def rounds(self, said: telemetry.Estimate) -> None:
        """The pad ranges."""
        for goal in self._server.open():
            if goal.own.session_id == said.session_id:
                goal.own.rounds = said.rounds
                self._say(goal)

    # -------------------------------------------------------------------------------------------------------------

    def _accept(self, goal: Any) -> _Followed:
        if goal.purpose not in ACTIONS or not 0 < len(goal.uav_id) <= 64:
            raise GoalRefusedError(
                f"purpose {goal.purpose[:20]!r} of drone {goal.uav_id[:64]!r}: name a drone, and {ACTIONS}"
            )
        if goal.pad_id not in {"", self._pad_id}:
            raise GoalRefusedError(f"pad_id {goal.pad_id[:64]!r}: this is {self._pad_id}")
        if not math.isfinite(goal.wait_s) or not 0 <= goal.wait_s <= MAX_WAIT_S:
            raise GoalRefusedError(f"wait_s: 0 to {MAX_WAIT_S:g} seconds")
        return _Followed(goal.uav_id, goal.purpose, self._clock() + round((goal.wait_s or WAIT_S) * 1_000))

    def _look(self, now_ms: int) -> None:
        for goal in self._server.open():
            if now_ms > goal.own.until_ms:
                self._end(goal, ABORTED, reason="no_verdict" if goal.own.session_id else "not_requested")

    def _say(self, goal: Goal[_Followed]) -> None:
        own = goal.own
        self._server.say(goal, {"session_id": own.session_id, "step": own.step, "rounds": own.rounds})

    def _end(self, goal: Goal[_Followed], status: int, **result: Any) -> None:
        self._server.end(goal, status, {"session_id": goal.own.session_id, **result})


def _cancelled(goal: Goal[_Followed]) -> Message:
    reason = "cancelled by the client; the drone's session goes on"
    return {"session_id": goal.own.session_id, "reason": reason}


def _fits(own: _Followed, message: Message) -> bool:
    return (own.uav_id, own.action) == (message["uav_id"], message["action"])
