"""The pad on Open-RMF's topics: a door, a lock while it is open, its queue, and alerts.

RMF may ask for the door and is shown what the ledger says of it. Nothing that comes by these topics permits anything:
anybody can publish there, and who asks is whoever it says it is.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final

from wonderland.asset_contract import CommittedEvent
from wonderland.clock import Clock
from wonderland.proofs.queue import Queue
from wonderland.proofs.queue_book import QueueBook
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland_rmw_zenoh.errors import WireError
from wonderland_rmw_zenoh.interfaces import Interfaces, MessageType
from wonderland_rmw_zenoh.node import Arrived, Node, Publication
from wonderland_rmw_zenoh.wire import Qos
from wonderland_ros_bridge.ros2 import door as says
from wonderland_ros_bridge.ros2.settings import OpenRmfSettings

_log = logging.getLogger(__name__)

STATES: Final = "/door_states"
REQUESTS: Final = ("/door_requests", "/adapter_door_requests")
"""As RMF's supervisor passes them on, for all that want the door; and as who wants it says so himself."""
GROUPS: Final = "/mutex_group_states"
MAX_BYTES: Final = 4_096
MAX_GROUPS_BYTES: Final = 1 << 20
MAX_REQUESTER: Final = 200
SHOWN: Final = 5
TELL_S: Final = 1.0
BREATH_S: Final = 0.1
"""Between two states at least: nobody's flood becomes one of ours."""
STRANGER_MS: Final = 60_000
_OPEN, _CLOSED = says.OPEN, says.CLOSED
_KEPT: Final = Qos(transient_local=True, depth=10)
_LOCKS: Final = Qos(transient_local=True, depth=100)

Message = Mapping[str, Any]


class OpenRmf:
    """The door of one pad; ``PadNode`` tells it of committed events and of whether pad and ledger are there."""

    def __init__(
        self,
        settings: OpenRmfSettings,
        node: Node,
        types: Interfaces,
        pad_id: str,
        clock: Clock,
        is_there: Callable[[], bool],
    ) -> None:
        self.name: Final = settings.door or pad_id
        self.mode = says.OFFLINE
        self._group = settings.mutex_group
        self._node = node
        self._types = types
        self._clock = clock
        self._is_there = is_there
        self._book = QueueBook(pad_id)
        self._wishes = says.Wishes()
        self._alerts: deque[Message] = deque(maxlen=100)
        self._due = asyncio.Event()
        self._sent: deque[bytes] = deque(maxlen=64)
        self._stranger_ms: int | None = None
        self._locked_ms: int | None = None
        self._holder = ""

    # --- what the ledger tells -----------------------------------------------------------------------------------

    def take(self, event: CommittedEvent) -> None:
        """An event of a committed, valid transaction about this pad. Raises ProofError."""
        self._book.take(event.name, event.record)
        news = self._clock() - event.t_ms <= says.NEWS_MS
        if event.name == "ProofDecided":
            verdict = Verdict.parse(event.record)
            if verdict.permission != "granted":
                self._wishes.answer()
                self._alert(says.refusal(self.name, verdict, event) if news else None)
        elif event.name == "ProofCancelled":
            self._wishes.answer()
            session = Session.parse(event.record)
            self._alert(says.broken_off(self.name, session, event) if news else None)
        self._due.set()

    def _alert(self, message: Message | None) -> None:
        if message is not None:
            self._alerts.append(message)

    # --- what RMF asks -------------------------------------------------------------------------------------------

    async def _requested(self, arrived: Arrived, kind: MessageType) -> None:
        asked = _decoded(arrived, kind)
        if asked.door_name != self.name:
            return
        requester, wanted = asked.requester_id, asked.requested_mode.value
        if not 0 < len(requester) <= MAX_REQUESTER or not requester.isprintable():
            raise WireError(f"requests by nobody, or by a name that has no 1 to {MAX_REQUESTER} printable letters")
        if wanted not in {_OPEN, _CLOSED}:
            raise WireError("requests for another mode than open (2) or closed (0)")
        wishes, now = self._wishes, self._clock()
        # RMF's supervisor answers each state with a request: one that changes nothing is not answered by a state.
        if wishes.ask(requester, now) if wanted == _OPEN else wishes.release(requester):
            _log.debug("door %s: %r asks for %s; only a proof opens it", self.name, requester, says.MODES[wanted])
            self._due.set()

    async def _stated(self, arrived: Arrived, kind: MessageType) -> None:
        """A state of a door: ours, as we sent it; another door's; or somebody else's of ours."""
        if arrived.data in self._sent:
            self._sent.remove(arrived.data)
            return
        if _decoded(arrived, kind).door_name != self.name:
            return
        now = self._clock()
        if self._stranger_ms is None or now - self._stranger_ms > STRANGER_MS:
            others = sorted({each.node for each in self._node.endpoints("MP", STATES)} - {self._node.name})
            _log.error(
                "door %s: somebody else publishes states of it, and RMF believes the latest; who publishes there: %s",
                self.name,
                ", ".join(others) or "somebody that does not show itself",
            )
        self._stranger_ms = now
        self._due.set()  # the true one again, so that the other one does not stand

    async def _grouped(self, arrived: Arrived, kind: MessageType) -> None:
        found = next((each for each in _decoded(arrived, kind).assignments if each.group == self._group), None)
        self._holder = "" if found is None or found.claimant == (1 << 64) - 1 else str(found.claimant)

    # -------------------------------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Publish until cancelled; at the end the door is offline."""
        request, state = (self._types.message(f"rmf_door_msgs/msg/{each}") for each in ("DoorRequest", "DoorState"))
        groups = self._types.message("rmf_fleet_msgs/msg/MutexGroupStates")
        states = self._node.advertise(STATES, state)
        queues = self._node.advertise("/ingestor_states", self._types.message("rmf_ingestor_msgs/msg/IngestorState"))
        alerts = self._node.advertise("/alert", self._types.message("rmf_task_msgs/msg/Alert"), _KEPT)
        locks = self._node.advertise(
            "/mutex_group_request", self._types.message("rmf_fleet_msgs/msg/MutexGroupRequest"), _LOCKS
        )
        for topic in REQUESTS:
            self._hear(topic, self._requested, request, MAX_BYTES)
        self._hear(STATES, self._stated, state, MAX_BYTES)
        if self._group is not None:
            self._hear(GROUPS, self._grouped, groups, MAX_GROUPS_BYTES, history=True)
        try:
            while True:
                self._due.clear()
                await self._tell(states, queues, locks)
                while self._alerts:
                    await alerts.publish(self._alerts.popleft())
                await asyncio.sleep(BREATH_S)
                try:
                    await asyncio.wait_for(self._due.wait(), TELL_S - BREATH_S)
                except TimeoutError:
                    continue
        finally:
            self._is_there = lambda: False
            await self._tell(states, queues, locks)

    def _hear(
        self, topic: str, take: Callable[[Arrived, MessageType], Any], kind: MessageType, limit: int, **more: bool
    ) -> None:
        self._node.subscribe(
            topic,
            lambda arrived: take(arrived, kind),
            depth=100,
            max_message_bytes=limit,
            kind=kind,
            **{"history": False, **more},
        )

    def _queue(self) -> Queue | None:
        return self._book.queue(self._clock()) if self._is_there() else None

    async def _tell(self, states: Publication, queues: Publication, locks: Publication) -> None:
        now, queue = self._clock(), self._queue()
        before, wished = self.mode, self._wishes.held(now, answered=False)
        self.mode = says.mode(queue, wished=bool(wished))
        if self.mode != before:
            # What anybody can bring about by asking fills no log.
            weight = logging.INFO if {before, self.mode} & {says.OPEN, says.OFFLINE} else logging.DEBUG
            _log.log(weight, "door %s: %s, before %s", self.name, says.MODES[self.mode], says.MODES[before])
        data = states.type.codec.encode(says.door_state(now, self.name, self.mode))
        self._sent.append(data)
        await states.publish_bytes(data)
        await queues.publish(says.ingestor_state(now, self.name, queue))
        if self._group is not None:
            await self._lock(locks, self._group, queue)

    async def _lock(self, locks: Publication, group: str, queue: Queue | None) -> None:
        """RMF's lock, while the ledger gives the pad to somebody: RMF sends nobody there meanwhile."""
        occupant = None if queue is None or says.permitted(queue) is None else queue.occupant
        if occupant is not None:
            self._locked_ms = occupant.since_ms
            await locks.publish(says.lock(group, self.name, self._locked_ms, says.LOCK))
        elif self._locked_ms is not None:
            await locks.publish(says.lock(group, self.name, self._locked_ms, says.RELEASE))
            self._locked_ms = None

    def diagnosed(self) -> tuple[str, str, Message]:
        """For diagnostics: a level, a message and values."""
        now = self._clock()
        held = self._wishes.held(now)
        more = "" if len(held) <= SHOWN else f" and {len(held) - SHOWN} more"
        values = {
            "mode": says.MODES[self.mode],
            "asked_for_by": ", ".join(held[:SHOWN]) + more,
            **({} if self._group is None else {"mutex_group": self._group, "mutex_group_held_by": self._holder}),
        }
        if self._stranger_ms is not None and now - self._stranger_ms <= STRANGER_MS:
            return "down", "somebody else publishes states of this door", values
        return "up", says.MODES[self.mode], values


def _decoded(arrived: Arrived, kind: MessageType) -> Any:
    """Raises WireError, DefinitionError."""
    if (arrived.type, arrived.type_hash) != (kind.name, kind.hash):
        raise WireError(f"messages that are no {kind.name} of hash {kind.hash}")
    return kind.codec.decode(arrived.data)
