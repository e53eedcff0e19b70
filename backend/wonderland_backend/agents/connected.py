"""Which agents are connected: one connection for each (kind, id)."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Annotated, Final

from wonderland.telemetry import PleaseProve
from wonderland_backend.context import part

PAD: Final = "pad"
UAV: Final = "uav"
REPLACED: Final = "the same agent has connected anew"
NO_LONGER_MEMBER: Final = "the certificate is no longer good"


@dataclass(eq=False)
class Agent:
    """One authenticated connection."""

    kind: str
    id: str
    spool: str
    msp_id: str = ""
    creator: bytes = b""
    """The SerializedIdentity that was checked when it came."""
    outbox: asyncio.Queue[PleaseProve] | None = None
    """What is to be sent to it; None where it takes nothing."""
    broken: bool = False
    """A batch of this connection was not kept: none after it may be."""
    end: Callable[[str], None] = field(default=lambda _why: None)
    """Ends the connection: `REPLACED` or `NO_LONGER_MEMBER`."""


class DuplicateAgent(Exception):  # noqa: N818 - an answer of the protocol
    """Another agent with this id, but another spool, is connected."""


class Agents:
    """The connected agents."""

    def __init__(self) -> None:
        self._agents: dict[tuple[str, str], Agent] = {}
        self._unproven: dict[asyncio.Timeout, None] = {}
        self.on_change: Callable[[str], None] = lambda _pad_id: None
        """Called with a pad's id when its agent came or went."""

    @property
    def unproven(self) -> int:
        """How many connections have yet to say who they are."""
        return len(self._unproven)

    @contextlib.contextmanager
    def proving(self, patience: asyncio.Timeout, most: int) -> Iterator[None]:
        """While a connection has yet to say who it is, for which `patience` waits.

        Of `most` the oldest gives way: agents say it at once, so that many who are silent shut none out.
        """
        if len(self._unproven) >= most:
            oldest = next(iter(self._unproven))
            del self._unproven[oldest]
            oldest.reschedule(asyncio.get_running_loop().time())
        self._unproven[patience] = None
        try:
            yield
        finally:
            self._unproven.pop(patience, None)

    def join(self, agent: Agent) -> None:
        """Take a connection in. The same agent's older one, which may hang half open, is replaced.

        Raises `DuplicateAgent` for a second agent of one id: told apart by their spools.
        """
        known = self._agents.get((agent.kind, agent.id))
        if known is not None:
            if known.spool != agent.spool:
                raise DuplicateAgent
            known.end(REPLACED)
        self._agents[agent.kind, agent.id] = agent
        self._changed(agent)

    def leave(self, agent: Agent) -> None:
        """A connection has ended."""
        if self._agents.get((agent.kind, agent.id)) is agent:
            del self._agents[agent.kind, agent.id]
            self._changed(agent)

    def dismiss(self, is_member: Callable[[str, bytes], bool]) -> None:
        """End the connections of those whose certificate was revoked, or has expired, since they came.

        `is_member` is asked with an agent's MSP id and its SerializedIdentity.
        """
        for agent in list(self._agents.values()):
            if not is_member(agent.msp_id, agent.creator):
                agent.end(NO_LONGER_MEMBER)

    def is_connected(self, agent_id: str, kind: str = PAD) -> bool:
        """Whether this agent, by default a pad's, is connected."""
        return (kind, agent_id) in self._agents

    def find_agent(self, kind: str, agent_id: str) -> Agent | None:
        """The connected agent of this id."""
        return self._agents.get((kind, agent_id))

    def __iter__(self) -> Iterator[Agent]:
        return iter(list(self._agents.values()))

    def __len__(self) -> int:
        return len(self._agents)

    def _changed(self, agent: Agent) -> None:
        if agent.kind == PAD:
            self.on_change(agent.id)


AgentsDep = Annotated[Agents, part(Agents)]
