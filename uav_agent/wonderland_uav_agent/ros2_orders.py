"""Orders for proofs from ROS 2: the action *ProveLocation* of a drone's own node, on this machine alone.

An order is a wish, as one of the backend's is: the drone proves at the pads that its operator named, one proof at a
time, and what follows rests on the ledger's verdict. Whoever reaches this machine's graph can give one.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self

from wonderland.clock import Clock
from wonderland.proofs.records.fields import ACTIONS
from wonderland.proofs.records.sessions import Session
from wonderland_uav_agent.agent import ProofResult
from wonderland_uav_agent.session.actions import ReportStep
from wonderland_uav_agent.willing import Willing

if TYPE_CHECKING:
    from wonderland_rmw_zenoh.actions import ActionServer, Goal

FORM: Final = "ros2[:tcp/127.0.0.1:PORT]"
TYPE: Final = "wonderland_msgs/action/ProveLocation"


class OrdersError(Exception):
    """Orders that cannot be taken; the text says why."""


@dataclass(slots=True)
class _Order:
    pad_id: str
    action: str
    session_id: str = ""
    result: ProofResult | None = None


class Ros2Orders:
    """Takes orders while it is open. Use as an asynchronous context manager, and await ``run``."""

    def __init__(self, text: str, uav_id: str, willing: Willing, clock: Clock) -> None:
        """``text`` as ``--orders`` has it. Raises OrdersError."""
        try:
            from wonderland_rmw_zenoh.actions import ActionServer  # noqa: PLC0415 - an extra
            from wonderland_rmw_zenoh.interfaces import SHARE, Interfaces  # noqa: PLC0415
            from wonderland_rmw_zenoh.node import Node  # noqa: PLC0415
            from wonderland_rmw_zenoh.wire import as_name  # noqa: PLC0415
        except ImportError:
            raise OrdersError(
                '--orders ros2: install what it needs: pip install "wonderland-uav-agent[ros2]"'
            ) from None
        self._uav_id = uav_id
        self._willing = willing
        self._stack = AsyncExitStack()
        self._node = Node(f"/wonderland/{as_name(uav_id)}", link_of(text))
        self._server: ActionServer[_Order] = ActionServer(
            self._node,
            f"{self._node.name}/prove_location",
            Interfaces([SHARE]).action(TYPE),
            clock,
            self._accept,
            self._cancelled,
        )

    async def __aenter__(self) -> Self:
        from wonderland_rmw_zenoh.errors import Ros2Error  # noqa: PLC0415

        try:
            await self._stack.enter_async_context(self._node)
        except Ros2Error as cause:
            raise OrdersError(f"--orders: {cause}") from cause
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._stack.aclose()

    async def run(self) -> None:
        """Take orders until cancelled. Raises OrdersError."""
        from wonderland_rmw_zenoh.errors import Ros2Error  # noqa: PLC0415

        try:
            await self._server.run()
        except Ros2Error as cause:
            raise OrdersError(f"--orders: {cause}") from cause

    def step(self, session: Session, report: ReportStep) -> None:
        """The agent reached a step."""
        for goal in self._server.open():
            own = goal.own
            if (own.pad_id, own.action) == (session.pad_id, session.action):
                own.session_id = session.session_id
                self._server.say(goal, {"session_id": session.session_id, "step": report.step})

    def _accept(self, goal: Any) -> _Order:
        from wonderland_rmw_zenoh.actions import GoalRefusedError  # noqa: PLC0415

        if goal.uav_id not in {"", self._uav_id}:
            raise GoalRefusedError(f"uav_id {goal.uav_id[:64]!r}: this is {self._uav_id}")
        if goal.purpose not in ACTIONS:
            raise GoalRefusedError(f"purpose {goal.purpose[:20]!r}: one of {', '.join(ACTIONS)}")
        order = _Order(goal.pad_id[:64], goal.purpose)
        why_not = self._willing.begin(
            order.pad_id, order.action, lambda why: self._ended(order, why), self._keeper(order)
        )
        if why_not:
            raise GoalRefusedError(why_not)
        return order

    def _keeper(self, order: _Order) -> Callable[[ProofResult], None]:
        def keep(result: ProofResult) -> None:
            order.result = result

        return keep

    def _ended(self, order: _Order, why_not: str) -> None:
        from wonderland_rmw_zenoh.actions import ABORTED, SUCCEEDED  # noqa: PLC0415

        verdict = None if order.result is None else order.result.verdict
        granted = verdict is not None and (verdict.outcome, verdict.permission) == ("verified", "granted")
        result: dict[str, Any] = {"session_id": order.session_id, "reason": why_not[:500]}
        if order.result is not None:
            result |= {"session_id": order.result.session_id, "tx_id": order.result.verdict_tx}
        if verdict is not None:
            reason = verdict.reasons[0].code if verdict.reasons else ""
            result |= {"outcome": verdict.outcome, "permission": verdict.permission, "reason": reason}
        for goal in self._server.open():
            if goal.own is order:
                self._server.end(goal, SUCCEEDED if granted else ABORTED, result)

    def _cancelled(self, goal: Goal[_Order]) -> dict[str, Any]:
        return {"session_id": goal.own.session_id, "reason": "cancelled by the client; the drone's proof goes on"}


def link_of(text: str) -> Any:
    """The session's link. Raises OrdersError for what is no such text, and for other machines."""
    from wonderland_rmw_zenoh.session import ROUTER, Link  # noqa: PLC0415

    kind, _, address = text.partition(":")
    link = Link(connect=(address or ROUTER,))
    problem = link.problem() if kind == "ros2" else "orders come by ros2"
    if problem:
        raise OrdersError(f"--orders {text[:200]}: {problem}; give {FORM}")
    return link
