"""Who speaks on a topic of ROS 2: two at once, or two in one name, are heard as none. Pure."""

from __future__ import annotations

from typing import Final

from wonderland_uav_agent.position.mavlink.doubled import Doubled

TWO_MS: Final = 5_000
"""Two publishers within this time are two at once."""


class Voices:
    """Of one topic."""

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._gid = b""
        self._seq = 0
        self._heard_ms = 0
        self._two_ms = 0
        self._doubled = Doubled()

    def heard(self, gid: bytes, seq: int, now_ms: int) -> None:
        """A message came, with what its publisher says of itself and its number."""
        if self._gid not in {b"", gid} and now_ms - self._heard_ms < TWO_MS:
            self._two_ms = now_ms
        elif gid == self._gid and seq <= self._seq:
            self._doubled.step_back(now_ms)
        self._gid, self._seq, self._heard_ms = gid, seq, now_ms

    def why_not(self, now_ms: int) -> str:
        """Why nothing of the topic is believed now; empty where it is."""
        if self._two_ms and now_ms - self._two_ms < TWO_MS:
            return f"two publish on {self._topic}, and which of them is the receiver cannot be told"
        if self._doubled.now(now_ms):
            return f"two publish on {self._topic} in one name: their messages' numbers do not follow each other"
        return ""
