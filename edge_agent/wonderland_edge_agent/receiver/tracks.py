"""One drone over all transports: which positions are new, what was missed, how late and how strong they come."""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import TYPE_CHECKING, Final

from wonderland_edge_agent.receiver.findings import (
    ClaimClock,
    Finding,
    FindingGate,
    Position,
    impossible_speed,
    two_places,
)
from wonderland_edge_agent.receiver.hearing import signature_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from wonderland.proofs.records.sessions import BroadcastClaim
    from wonderland.telemetry import Signature
    from wonderland_edge_agent.receiver.limits import TokenBucket
    from wonderland_remote_id import SelfId, System, UaType
    from wonderland_remote_id.drip.observer import Observation, Observer

DUPLICATE_MS: Final = 1_000
"""The same content from elsewhere within this is the same message: a drone sends each over every transport it has."""
MAX_TRANSMITTERS: Final = 8
MAX_RECENT: Final = 16
MAX_SIGNATURES: Final = 64
COUNTER_MS: Final = 10_000
"""A counter that was silent for longer may have gone round, or the drone was out of reach: nothing follows from it."""
TRANSPORT_MS: Final = 10_000
_STRENGTH: Final = ("refused", "unknown_signer", "endorsed", "verified")


class Transmitter:
    """One way by which a drone is heard: a transport and an address."""

    __slots__ = ("bucket", "clock", "counters", "last")

    def __init__(self, bucket: TokenBucket) -> None:
        self.bucket = bucket
        self.clock = ClaimClock()
        self.last: Position | None = None
        self.counters: dict[int, tuple[int, int]] = {}

    def missed(self, kind: int, counter: int | None, t_ms: int) -> int:
        """How many messages of this type were not heard since the last one."""
        if counter is None:
            return 0
        known = self.counters.get(kind)
        if known is not None and (counter - known[0]) % 256 >= 128:
            return 0  # an older one that comes late
        self.counters[kind] = counter, t_ms
        if known is None or not 0 <= t_ms - known[1] <= COUNTER_MS:
            return 0
        return max(0, (counter - known[0]) % 256 - 1)


class DroneTrack:
    """What is known of one drone."""

    __slots__ = (
        "_recent", "_transmitter_bucket", "_transmitters", "_transports", "bucket", "drip", "duplicates", "history",
        "latency_ms", "lost", "observer", "operator_id", "self_id", "signatures", "system", "ua_type", "unsure",
    )  # fmt: skip

    def __init__(self, bucket: TokenBucket, transmitter_bucket: Callable[[], TokenBucket], history: int) -> None:
        self.bucket = bucket
        self._transmitter_bucket = transmitter_bucket
        self.history: deque[BroadcastClaim] = deque(maxlen=history)
        self.unsure: deque[BroadcastClaim] = deque(maxlen=history)
        """Positions of transmitters that named other drones as well: they may be this one's."""
        self.operator_id: str | None = None
        self.system: System | None = None
        self.self_id: SelfId | None = None
        self.ua_type: UaType | None = None
        self.latency_ms: int | None = None
        self.lost = 0
        self.duplicates = 0
        self.drip: Observation | None = None
        self.signatures: deque[Observation] = deque(maxlen=MAX_SIGNATURES)
        self.observer: Observer | None = None
        self._transmitters: OrderedDict[str, Transmitter] = OrderedDict()
        self._recent: deque[tuple[bytes, int, str, int | None]] = deque(maxlen=MAX_RECENT)
        self._transports: dict[str, int] = {}

    def transports(self, now_ms: int) -> tuple[str, ...]:
        """The transports over which it was heard lately, by name."""
        return tuple(sorted(name for name, t_ms in self._transports.items() if 0 <= now_ms - t_ms <= TRANSPORT_MS))

    def take_signature(self, observation: Observation) -> None:
        """Note what an authentication message came to."""
        self.signatures.append(observation)
        if self.drip is None or not self.drip.outlasts(observation):
            self.drip = observation

    def signature(self, since_ms: int) -> Signature | None:
        """Who signed since then: the last of the strongest kind, and how many were ``refused`` besides."""
        seen = [each for each in self.signatures if each.t_ms >= since_ms]
        if not seen:
            return None
        strongest = max(seen, key=lambda each: (_STRENGTH.index(each.state), each.covers_location, each.t_ms))
        refused = sum(each.state == "refused" for each in seen)
        return signature_of(strongest, refused)

    def count(self, source: str, transport: str, kind: int, counter: int | None, now_ms: int) -> None:
        """Note that a frame of message type ``kind`` was heard."""
        self._transports[transport] = now_ms
        self.lost += self._transmitter(source).missed(kind, counter, now_ms)

    def is_duplicate(self, content: bytes, source: str, counter: int | None, now_ms: int) -> bool:
        """Whether this position was heard before: over another way, or again with the same counter."""
        for known, t_ms, where, number in self._recent:
            if known == content and 0 <= now_ms - t_ms <= DUPLICATE_MS:
                if where != source or (counter is not None and number == counter):
                    self.duplicates += 1
                    return True
                break
        self._recent.appendleft((content, now_ms, source, counter))
        return False

    def takes(self, source: str, now_ms: int) -> bool:
        """Whether one more position of this transmitter is taken now."""
        return self._transmitter(source).bucket.take_token(now_ms) and self.bucket.take_token(now_ms)

    def compare_position(self, uav_id: str, source: str, position: Position, gate: FindingGate) -> None:
        """Compare a position with those before it, of this transmitter and of others."""
        here = self._transmitter(source)
        findings: list[Finding | None] = [here.clock.compare_time(uav_id, position)]
        if here.last is not None:
            findings.append(impossible_speed(uav_id, position, here.last))
        for name, other in self._transmitters.items():
            if name != source and other.last is not None:
                findings.append(two_places(uav_id, position, other.last))
        here.last = position
        for finding in findings:
            gate.put(finding)

    def _transmitter(self, source: str) -> Transmitter:
        found = self._transmitters.get(source)
        if found is None:
            found = self._transmitters[source] = Transmitter(self._transmitter_bucket())
            if len(self._transmitters) > MAX_TRANSMITTERS:
                self._transmitters.popitem(last=False)
        else:
            self._transmitters.move_to_end(source)
        return found
