"""Whether agents may stay connected: only as members of the channel, as it is now."""

from __future__ import annotations

from collections.abc import Callable

from wonderland_backend.agents.connected import NO_LONGER_MEMBER, PAD, UAV, Agents
from wonderland_backend.agents.members import Members
from wonderland_backend.mirror.derive import Changes
from wonderland_backend.mirror.rows import DroneWrite, PadWrite


class Standing:
    """Ends the connections of agents that are members no longer, or whose pad or drone is another organisation's."""

    def __init__(self, agents: Agents, members: Members, clock: Callable[[], int]) -> None:
        self._agents = agents
        self._members = members
        self._clock = clock

    def committed(self, changes: Changes) -> None:
        """The channel's configuration may have changed, or whose a pad or drone is."""
        for kind, rows in ((PAD, changes.rows(PadWrite)), (UAV, changes.rows(DroneWrite))):
            for (agent_id,), row in rows.items():
                agent = self._agents.find_agent(kind, str(agent_id))
                if agent is not None and agent.msp_id != row.msp_id:
                    agent.end(NO_LONGER_MEMBER)
        if changes.organisations is not None:
            self._members.configure((row.msp_id, row.definition) for row in changes.organisations)
            self.check()

    def check(self) -> None:
        """Look at all of them: certificates run out by themselves, too."""
        now = self._clock()
        self._agents.dismiss(lambda msp_id, creator: self._members.is_member(msp_id, creator, now))
