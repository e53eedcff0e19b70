"""Frames in, attributed positions and findings out: puts together what drones spread over messages. No I/O.

Single messages carry no identity but their source's. Where one source (a receiver that relays without telling the
transmitters' addresses) names several drones outside packs, its single positions could be anyone's: they are counted
and given to nobody, since a wrong attribution would be held against an honest drone.
"""

from __future__ import annotations

import re
from collections import OrderedDict, deque
from typing import TYPE_CHECKING, Final

from wonderland import telemetry
from wonderland.proofs.records.fields import ID_PATTERN
from wonderland.proofs.records.sessions import BroadcastClaim
from wonderland_edge_agent.receiver.findings import (
    RATE_HIGH,
    SEVERAL_IDENTITIES,
    SIGNATURE_BAD,
    Finding,
    FindingGate,
    Position,
)
from wonderland_edge_agent.receiver.heard import Heard, ReceiverCounts
from wonderland_edge_agent.receiver.hearing import heard_of
from wonderland_edge_agent.receiver.limits import ReceiverLimits, TokenBucket
from wonderland_edge_agent.receiver.tracks import DroneTrack
from wonderland_edge_agent.receiver.transmitters import Source, Sources
from wonderland_remote_id import (
    BasicId,
    IdType,
    Location,
    OperatorId,
    Pack,
    RemoteIdError,
    SelfId,
    System,
    UaType,
    decode,
    encode,
    public_operator_id,
)

if TYPE_CHECKING:
    from wonderland.telemetry import Signature
    from wonderland_remote_id import Message
    from wonderland_remote_id.drip.registry import Registry

MAX_IDENTITIES: Final = 8
"""Identities remembered of one source: two already make it ambiguous."""
_PREFERRED: Final = (IdType.SERIAL_NUMBER, IdType.CAA_REGISTRATION, IdType.UTM_UUID, IdType.SPECIFIC_SESSION)
_UAV_ID: Final = re.compile(ID_PATTERN + r"\Z")


class Assembler:
    """Bounded in memory and work whatever comes in; see `ReceiverLimits`."""

    def __init__(self, now_ms: int, limits: ReceiverLimits | None = None, drip: Registry | None = None) -> None:
        self._drip = drip
        self._limits = limits or ReceiverLimits()
        self._sources = Sources(self._limits, now_ms)
        self._drones: OrderedDict[str, DroneTrack] = OrderedDict()
        self._watched: set[str] = set()
        self._new = TokenBucket(self._limits.new_drones_per_s, 4 * self._limits.new_drones_per_s, now_ms)
        self._gate = FindingGate()
        self._frames = self._bad = self._limited = self._unattributed = self._ambiguous = self._heard = 0
        self._duplicates = 0

    @property
    def counts(self) -> ReceiverCounts:
        """What became of the frames so far."""
        return ReceiverCounts(
            frames=self._frames,
            bad=self._bad,
            limited=self._limited,
            unattributed=self._unattributed,
            ambiguous=self._ambiguous,
            heard=self._heard,
            duplicates=self._duplicates,
            lost=sum(drone.lost for drone in self._drones.values()),
            drones=len(self._drones),
        )

    def watch(self, uav_id: str) -> None:
        """Keep this drone's history whatever else comes, and more of it: it is being proved."""
        self._watched.add(uav_id)
        drone = self._drones.get(uav_id)
        if drone is not None:
            drone.history = deque(drone.history, maxlen=self._limits.watched_history)

    def unwatch(self, uav_id: str) -> None:
        """End what `watch` began."""
        self._watched.discard(uav_id)
        drone = self._drones.get(uav_id)
        if drone is not None:
            drone.history = deque(drone.history, maxlen=self._limits.history)

    def recent(self, uav_id: str, since_ms: int) -> tuple[BroadcastClaim, ...]:
        """What is remembered of a drone from ``since_ms`` on, in order of time."""
        drone = self._drones.get(uav_id)
        if drone is None:
            return ()
        return tuple(sorted((claim for claim in drone.history if claim.t_ms >= since_ms), key=lambda claim: claim.t_ms))

    def unsure(self, uav_id: str, since_ms: int) -> tuple[BroadcastClaim, ...]:
        """What may have been a watched drone's, or another's that its transmitter named as well."""
        drone = self._drones.get(uav_id)
        return () if drone is None else tuple(claim for claim in drone.unsure if claim.t_ms >= since_ms)

    def signature(self, uav_id: str, since_ms: int) -> Signature | None:
        """Who signed what was heard of a drone from ``since_ms`` on."""
        drone = self._drones.get(uav_id)
        return drone.signature(since_ms) if drone is not None else None

    def count_bad(self) -> None:
        """Count what a framing could not make a frame of."""
        self._frames += 1
        self._bad += 1

    def findings(self) -> list[Finding]:
        """What was odd since the last call."""
        return self._gate.take_findings()

    def feed(
        self,
        frame: bytes,
        *,
        source: str,
        transport: str,
        now_ms: int,
        rssi_dbm: int | None = None,
        counter: int | None = None,
        address: str | None = None,
    ) -> Heard | None:
        """Take one frame; the position in it when there is one, it is new and its drone is known. Never raises.

        ``source`` tells transmitters apart as well as the receiver can; ``address`` is the transmitter's own where it
        is known, ``counter`` the message counter of the frame's wrapping.
        """
        self._frames += 1
        sender = self._sources.admit(source, now_ms)
        if sender is None:
            self._limited += 1
            return None
        try:
            decoded = decode(frame)
        except RemoteIdError:
            self._bad += 1
            return None
        messages = decoded.messages if isinstance(decoded, Pack) else (decoded,)
        uav_id = self._identity(sender, messages, now_ms, address)
        location = next((message for message in messages if isinstance(message, Location)), None)
        if uav_id is None:
            if location is not None:
                self._unattributed += 1
            return None
        if not uav_id:
            if location is not None:
                self._ambiguous += 1
                self._keep_unsure(sender, location, transport, now_ms)
            return None
        drone = self._drone(uav_id, now_ms)
        if drone is None:
            self._limited += 1
            return None
        self._describe(drone, messages)
        drone.count(source, transport, frame[0] >> 4, counter, now_ms)
        if self._drip is not None:
            self._authenticate(uav_id, drone, frame, messages, now_ms)
        if location is None or location.lat_e7 is None or location.lon_e7 is None:
            return None
        if drone.is_duplicate(encode(location), source, counter, now_ms):
            self._duplicates += 1
            return None
        heard = heard_of(uav_id, drone, location, transport=transport, now_ms=now_ms, rssi_dbm=rssi_dbm)
        watched = uav_id in self._watched
        if watched:  # whoever floods, its session sees everything and chooses
            drone.history.append(heard.claim())
        if not drone.takes(source, now_ms):
            self._limited += 1
            self._gate.put(Finding(now_ms, telemetry.Finding(uav_id=uav_id, kind=RATE_HIGH, transport=transport)))
            return None
        drone.compare_position(uav_id, source, _position(heard), self._gate)
        if not watched:
            drone.history.append(heard.claim())
        self._heard += 1
        return heard

    def _identity(self, sender: Source, messages: tuple[Message, ...], now_ms: int, address: str | None) -> str | None:
        """Whose the messages are: None when nobody said, "" when several did."""
        here: dict[tuple[IdType, str], int] = {}
        for message in messages:
            if isinstance(message, BasicId) and message.id_type is not IdType.NONE:
                uas_id = message.uas_id.rstrip(" ")
                if _UAV_ID.match(uas_id):
                    here[message.id_type, uas_id] = now_ms
        known = sender.identities
        for key in here:
            known.pop(key, None)
            known[key] = now_ms
        while len(known) > MAX_IDENTITIES:
            del known[next(iter(known))]
        if address is not None and here:
            self._look_at_names(known, now_ms)
        if here and len(messages) > 1:
            return _preferred(here)
        oldest_ms = now_ms - self._limits.identity_lifetime_ms
        for key in [key for key, t_ms in known.items() if not oldest_ms <= t_ms <= now_ms]:
            del known[key]
        return _preferred(known)

    def _keep_unsure(self, sender: Source, location: Location, transport: str, now_ms: int) -> None:
        if location.lat_e7 is None or location.lon_e7 is None:
            return
        for _, name in sender.identities:
            drone = self._drones.get(name) if name in self._watched else None
            if drone is not None:
                heard = heard_of(name, drone, location, transport=transport, now_ms=now_ms, rssi_dbm=None)
                drone.unsure.append(heard.claim())

    def _look_at_names(self, known: dict[tuple[IdType, str], int], now_ms: int) -> None:
        """One transmitter, several serial numbers: not a relay, whose frames keep their senders' addresses."""
        since_ms = now_ms - self._limits.identity_lifetime_ms
        serials = [name for (kind, name), t_ms in known.items() if kind is IdType.SERIAL_NUMBER and t_ms >= since_ms]
        if len(serials) > 1:
            self._gate.put(
                Finding(
                    now_ms,
                    telemetry.Finding(
                        uav_id=serials[-1],
                        kind=SEVERAL_IDENTITIES,
                        other_uav_id=serials[-2],
                        count=len(serials) - 1,
                    ),
                )
            )

    def _authenticate(
        self, uav_id: str, drone: DroneTrack, frame: bytes, messages: tuple[Message, ...], now_ms: int
    ) -> None:
        """Who signed it (RFC 9575). It says nothing about whether the position is true."""
        if drone.observer is None:
            # Few pads believe registries; the others need not carry the cryptography.
            from wonderland_remote_id.drip.observer import Observer  # noqa: PLC0415

            assert self._drip is not None
            drone.observer = Observer(self._drip, uav_id)
        observation = drone.observer.feed(frame, messages, now_ms)
        if observation is not None:
            drone.take_signature(observation)
            if observation.state == "refused":
                self._gate.put(Finding(now_ms, telemetry.Finding(uav_id=uav_id, kind=SIGNATURE_BAD)))

    def _drone(self, uav_id: str, now_ms: int) -> DroneTrack | None:
        """The drone's place; a new one only where new ones do not come too fast, and then in place of the stalest."""
        drone = self._drones.get(uav_id)
        if drone is not None:
            self._drones.move_to_end(uav_id)
            return drone
        watched = uav_id in self._watched
        if not self._new.take_token(now_ms) and not watched:
            return None
        if len(self._drones) >= self._limits.drones:
            stalest = next((known for known in self._drones if known not in self._watched), None)
            if stalest is None:
                return None
            del self._drones[stalest]
        rate = self._limits.positions_per_drone_s
        each = self._limits.positions_per_transmitter_s
        drone = DroneTrack(
            TokenBucket(rate, rate, now_ms),
            lambda: TokenBucket(each, each, now_ms),
            self._limits.watched_history if watched else self._limits.history,
        )
        self._drones[uav_id] = drone
        return drone

    @staticmethod
    def _describe(drone: DroneTrack, messages: tuple[Message, ...]) -> None:
        for message in messages:
            if isinstance(message, OperatorId):
                # The boundary: what follows the dash is the operator's secret and goes no further.
                drone.operator_id = public_operator_id(message.operator_id.strip()) or None
            elif isinstance(message, System):
                drone.system = message
            elif isinstance(message, SelfId):
                drone.self_id = message if message.text.strip() else None
            elif isinstance(message, BasicId) and message.ua_type is not UaType.NONE:
                drone.ua_type = message.ua_type


def _preferred(identities: dict[tuple[IdType, str], int]) -> str | None:
    """The one identity of the most telling kind there is; "" where that kind has several."""
    for kind in _PREFERRED:
        names = [name for id_type, name in identities if id_type is kind]
        if names:
            return names[0] if len(names) == 1 else ""
    return None


def _position(heard: Heard) -> Position:
    said = heard.track
    return Position(said.lat_e7, said.lon_e7, said.accuracy_mm, heard.t_ms, said.claim_t_ms, said.transport)
