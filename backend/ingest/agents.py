"""Which agents are connected: one connection for each (kind, id)."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

PAD: Final = "pad"


@dataclass(eq=False)
class Agent:
    """One authenticated connection."""

    kind: str
    id: str
    spool: str
    replaced: Callable[[], None] = field(default=lambda: None)
    """Called when the same agent connects anew."""


class DuplicateAgent(Exception):  # noqa: N818 - an answer of the protocol
    """Another agent with this id, but another spool, is connected."""


class Agents:
    """The connected agents."""

    def __init__(self) -> None:
        self._agents: dict[tuple[str, str], Agent] = {}
        self.unproven = 0
        self.on_change: Callable[[str], None] = lambda _pad_id: None
        """Called with a pad's id when its agent came or went."""

    @contextlib.contextmanager
    def proving(self) -> Iterator[None]:
        """While a connection has yet to say who it is."""
        self.unproven += 1
        try:
            yield
        finally:
            self.unproven -= 1

    def join(self, agent: Agent) -> None:
        """Take a connection in. The same agent's older one, which may hang half open, is replaced.

        Raises `DuplicateAgent` for a second agent of one id: told apart by their spools.
        """
        known = self._agents.get((agent.kind, agent.id))
        if known is not None:
            if known.spool != agent.spool:
                raise DuplicateAgent
            known.replaced()
        self._agents[agent.kind, agent.id] = agent
        self._changed(agent)

    def leave(self, agent: Agent) -> None:
        """A connection has ended."""
        if self._agents.get((agent.kind, agent.id)) is agent:
            del self._agents[agent.kind, agent.id]
            self._changed(agent)

    def is_connected(self, pad_id: str) -> bool:
        """Whether this pad's agent is connected."""
        return (PAD, pad_id) in self._agents

    def __len__(self) -> int:
        return len(self._agents)

    def _changed(self, agent: Agent) -> None:
        if agent.kind == PAD:
            self.on_change(agent.id)
