"""A radio that answers with what it overheard: the replay of an old session.

It sits in the air between a drone's node and the pad's (``Air.intercept``): it keeps the frames that honest drones
send at a pad and, for the drone that replays, puts these in the place of its own. The frames are genuine, but sealed
with the keys of another session.
"""

from __future__ import annotations

from collections import deque
from typing import Final

MAX_OVERHEARD: Final = 512


class ReplayAttack:
    """``replaying``: names of the nodes that replay; ``pad_of``: the pad that a drone's node speaks to."""

    def __init__(self, replaying: frozenset[str], pad_of: dict[str, str]) -> None:
        self._replaying = replaying
        self._pad_of = pad_of
        self._overheard: dict[str, deque[bytes]] = {}
        self.replayed = 0

    def intercept(self, sender: str, receiver: str, data: bytes) -> bytes | None:
        """``wonderland_simulator.uci_node.air.Intercept``: what arrives at the receiver."""
        del receiver
        pad_id = self._pad_of.get(sender)
        if pad_id is None:
            return data  # from a pad to a drone
        frames = self._overheard.setdefault(pad_id, deque(maxlen=MAX_OVERHEARD))
        if sender not in self._replaying:
            frames.append(data)
            return data
        if not frames:
            return None
        self.replayed += 1
        frames.rotate(-1)
        return frames[-1]
