"""Whether agents may stay connected: only as members of the channel, as it is now."""

from __future__ import annotations

from collections.abc import Callable

from wonderland_backend.agents.connected import Agents
from wonderland_backend.agents.members import Members
from wonderland_backend.mirror.derive import Changes


class Standing:
    """Ends the connections of agents that are members no longer."""

    def __init__(self, agents: Agents, members: Members, clock: Callable[[], int]) -> None:
        self._agents = agents
        self._members = members
        self._clock = clock

    def committed(self, changes: Changes) -> None:
        """The channel's configuration may have changed."""
        if changes.organisations is not None:
            self._members.configure((row.msp_id, row.definition) for row in changes.organisations)
            self.check()

    def check(self) -> None:
        """Look at all of them: certificates run out by themselves, too."""
        now = self._clock()
        self._agents.dismiss(lambda msp_id, creator: self._members.is_member(msp_id, creator, now))
