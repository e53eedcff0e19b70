"""What is broadcast by the word of the autopilot's own MAVLink: OPEN_DRONE_ID_*, from it and from its transmitters.

The drone signs for it, so few are believed: the autopilot that the position comes from (component 1) and Remote ID
transmitters of its system on its link (components 236 to 238). On a link without signatures, anybody there can say
that he is one of them. He cannot take their place unseen: whoever states what the first of them does not, names another
drone, or numbers his messages beside theirs, ends the signing for all, for as long as he goes on.
"""

from __future__ import annotations

import logging
from collections import deque
from typing import Final, NamedTuple

from wonderland.clock import Clock
from wonderland_remote_id import Location, Pack, RemoteIdError, decode
from wonderland_remote_id.framings.mavlink import parse_datagram
from wonderland_uav_agent.broadcasts.positions import OwnPositions, serials
from wonderland_uav_agent.position.mavlink.doubled import Doubled
from wonderland_uav_agent.position.mavlink.messages import Message, OutOfStep, RemoteIdHeard, Sender

_log = logging.getLogger(__name__)

SPEAKERS: Final = frozenset({1, 236, 237, 238})
"""MAV_COMP_ID_AUTOPILOT1 and MAV_COMP_ID_ODID_TXRX_1 to 3."""
SPEAKS_MS: Final = 3_000
"""Who stated a position so recently speaks; they come once a second."""
UNSURE_MS: Final = 10_000
"""So long nothing is signed for after something odd: BASIC_ID comes every three seconds."""
REMEMBERED: Final = 64


class _Stated(NamedTuple):
    heard_ms: int
    said_ms: int
    digest: bytes


class AutopilotBroadcasts(OwnPositions):
    """Of the link that it listens to: `MavlinkPosition.tell_of_remote_id`."""

    def __init__(self, uav_id: str, clock: Clock) -> None:
        super().__init__(uav_id, clock)
        self._follow(None)
        self._unsure_ms: int | None = None
        self._said: set[str] = set()
        self.strangers = 0
        """Messages of others than the autopilot and its transmitters."""
        self.backwards = 0
        """Positions with a time before that of their sender's last one."""
        self.packets = 0

    def sent(self, since_ms: int) -> tuple[bytes, ...]:
        """Nothing while it is not sure whose they are."""
        return () if self.unsure(self._clock()) else super().sent(since_ms)

    def unsure(self, now_ms: int) -> bool:
        """Whether something odd was heard a moment ago."""
        return self._unsure_ms is not None and now_ms - self._unsure_ms <= UNSURE_MS

    def hear(self, message: Message, sender: Sender, followed: Sender | None, now_ms: int) -> None:
        """A message on the link; whatever it is, this raises nothing."""
        if followed is None:
            return
        if followed != self._followed:
            self._follow(followed)
        own = (sender.system, sender.peer) == (followed.system, followed.peer) and sender.component in SPEAKERS
        if isinstance(message, OutOfStep) and own:
            if self._doubled[sender.component].step_back(now_ms):
                self._doubt(f"two speak as component {sender.component}", now_ms)
        elif isinstance(message, RemoteIdHeard):
            self.packets += 1
            if own:
                self._take(message.packet, sender.component, now_ms)
            else:
                self._pass_over(sender)

    def _follow(self, followed: Sender | None) -> None:
        """What another autopilot's transmitters stated is not this one's."""
        self._followed = followed
        self._voices = {component: deque[_Stated](maxlen=REMEMBERED) for component in SPEAKERS}
        self._doubled = {component: Doubled() for component in SPEAKERS}
        self._sent.clear()

    def _pass_over(self, sender: Sender) -> None:
        self.strangers += 1
        if self.strangers == 1:
            _log.warning(
                "system %d, component %d speaks of Remote ID, and is no transmitter of the autopilot’s: left out",
                sender.system,
                sender.component,
            )

    def _take(self, packet: bytes, component: int, now_ms: int) -> None:
        for one in parse_datagram(packet):
            if isinstance(one, RemoteIdError):
                self._count_bad(one)
                continue
            try:
                decoded = decode(one.frame)
            except RemoteIdError as error:
                self._count_bad(error)
                continue
            messages = decoded.messages if isinstance(decoded, Pack) else (decoded,)
            others = serials(messages) - {self._uav_id}
            if others:
                self.foreign += 1
                self._doubt(
                    f"component {component} broadcasts serial number {min(others)}, and this drone’s certificate says "
                    f"{self._uav_id}; set the module’s to that",
                    now_ms,
                )
                continue
            for message in messages:
                if isinstance(message, Location):
                    self._position(message, component, now_ms)

    def _position(self, location: Location, component: int, now_ms: int) -> None:
        found = self._dated(location, now_ms)
        if found is None:
            return
        stated, voice = _Stated(now_ms, *found), self._voices[component]
        if voice and now_ms - voice[-1].heard_ms <= SPEAKS_MS:
            last = voice[-1]
            if stated.said_ms < last.said_ms:
                self.backwards += 1
                self._say_once(f"component {component} states a position older than its last one; it is left out")
                return
            if stated.said_ms == last.said_ms and stated.digest != last.digest:
                self._doubt(f"component {component} states two positions for one moment", now_ms)
                return
            if stated.digest == last.digest:
                return
        voice.append(stated)
        first = min(each for each, said in self._voices.items() if said and now_ms - said[-1].heard_ms <= SPEAKS_MS)
        if stated.digest not in {each.digest for each in self._voices[first]}:
            self._doubt(f"component {component} states positions that component {first} does not", now_ms)
        elif not self.unsure(now_ms):
            self._sent.append((now_ms, stated.digest))

    def _doubt(self, why: str, now_ms: int) -> None:
        """What was heard before may be the other's, too."""
        self._sent.clear()
        self._unsure_ms = now_ms
        self._say_once(f"{why}: no broadcast is signed for while that lasts")

    def _say_once(self, what: str) -> None:
        """Each oddity once; a flood of different ones no more often than so many times."""
        if what not in self._said and len(self._said) < REMEMBERED:
            self._said.add(what)
            _log.warning("%s", what)
