"""Listening to one drone: its authentication messages against the registries and against what it broadcast."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

from wonderland_remote_id.drip.det import Det, DripError, message_hash
from wonderland_remote_id.drip.formats import (
    Link,
    Manifest,
    Sam,
    SamType,
    SignedEvidence,
    Wrapper,
    parse_sam,
    verify,
)
from wonderland_remote_id.drip.pages import AuthenticationMessage, PageAssembler
from wonderland_remote_id.drip.registry import CLOCK_SKEW_MS, Registry
from wonderland_remote_id.encoding import encode
from wonderland_remote_id.enums import AuthenticationType, IdType, MessageType
from wonderland_remote_id.messages import Authentication, BasicId, Location, Message

MAX_HEARD: Final = 64
"""Frames remembered for manifests: about ten seconds of broadcasts over all transports."""
SIGNED_FOR_MS: Final = 30_000
"""So long a signature of the drone's counts for more than the endorsements that it repeats in between."""
State = Literal["verified", "endorsed", "unknown_signer", "refused"]
Format = Literal["link", "wrapper", "manifest", "frame"]
_NAMES: Final[dict[SamType, Format]] = {
    SamType.LINK: "link",
    SamType.WRAPPER: "wrapper",
    SamType.MANIFEST: "manifest",
    SamType.FRAME: "frame",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """What one authentication message comes to.

    ``verified``: signed by ``det``, whose key ``signer`` registered. ``endorsed``: a Link by which ``signer`` vouches
    for the key of ``det``; anybody can repeat it, nothing is signed by that key yet. ``unknown_signer``: nobody who is
    believed has vouched for its key. ``refused``: it contradicts itself, its registry or what was heard; ``reason``
    says how. ``covers_location``: a position that was heard is among what is signed. ``bound``: the identity that the
    drone is heard under is ``det``; otherwise they were only heard together.
    """

    state: State
    format: Format
    det: str
    t_ms: int
    signer: str | None = None
    reason: str | None = None
    covers_location: bool = False
    bound: bool = False

    def outlasts(self, other: Observation) -> bool:
        """Whether this is still what to tell of a drone after ``other``, which came later."""
        if self.state != "verified" or other.state not in {"endorsed", "unknown_signer"}:
            return False
        return 0 <= other.t_ms - self.t_ms <= SIGNED_FOR_MS


class Observer:
    """One drone's authentication. Sans-I/O; bounded. ``name`` is the identity that the drone is heard under."""

    def __init__(self, registry: Registry, name: str = "") -> None:
        self._registry = registry
        self._name = name
        self._pages = PageAssembler()
        self._heard: deque[tuple[bytes, bool]] = deque(maxlen=MAX_HEARD)
        self._det: Det | None = None

    def feed(self, frame: bytes, messages: Sequence[Message], now_ms: int) -> Observation | None:
        """Take a frame and the messages in it; what its authentication comes to when it completes one."""
        plain: list[Message] = [message for message in messages if not isinstance(message, Authentication)]
        for known in plain:
            if isinstance(known, BasicId) and known.id_type is IdType.SPECIFIC_SESSION:
                self._det = Det.of_session_id(known.uas_id)
        located = any(isinstance(known, Location) for known in plain)
        self._heard.append((message_hash(frame), located))
        if len(messages) > 1:  # on Bluetooth 4 the same messages come one by one, and are hashed one by one
            self._heard.extend((message_hash(encode(known)), isinstance(known, Location)) for known in plain)
        found = None
        for message in messages:
            if (
                isinstance(message, Authentication)
                and message.authentication_type is AuthenticationType.SPECIFIC_AUTHENTICATION
            ):
                whole = self._pages.feed(message, now_ms)
                if whole is not None:
                    found = self._judge(whole, plain, now_ms) or found
        return found

    def _judge(self, whole: AuthenticationMessage, plain: Sequence[Message], now_ms: int) -> Observation | None:
        try:
            sam = parse_sam(whole.data)
        except DripError:
            return None  # another specific method than DRIP, or broken beyond telling whose it is
        self._heard.append((message_hash(b"".join(whole.pages)), False))
        if isinstance(sam, Link):
            return self._link(sam, now_ms)
        return self._signed(sam, sam.signed, plain, now_ms, _NAMES[SamType(whole.data[0])])

    def _link(self, link: Link, now_ms: int) -> Observation | None:
        """A drone repeats the endorsements of its registries, too: those say nothing about itself."""
        det, bound = str(link.child), link.child.names(self._name)
        try:
            identity = self._registry.learn(link, now_ms)
        except DripError as error:
            return Observation(state="refused", format="link", det=det, t_ms=now_ms, reason=error.message)
        if identity is not None and identity.is_authority:
            return None
        if self._det is not None and link.child != self._det:
            if identity is None:
                return None  # perhaps of a registry whose own endorsement was not heard yet
            reason = "endorses another entity tag than the Basic ID's"
            return Observation(state="refused", format="link", det=det, t_ms=now_ms, reason=reason)
        if identity is None:
            return Observation(state="unknown_signer", format="link", det=det, t_ms=now_ms, bound=bound)
        return Observation(state="endorsed", format="link", det=det, t_ms=now_ms, signer=identity.name, bound=bound)

    def _signed(
        self, sam: Sam, signed: SignedEvidence, plain: Sequence[Message], now_ms: int, name: Format
    ) -> Observation:
        det, bound = str(signed.det), signed.det.names(self._name)
        if self._det is not None and signed.det != self._det:
            reason = "signed by another entity tag than the Basic ID's"
            return Observation(state="refused", format=name, det=det, t_ms=now_ms, reason=reason)
        identity = self._registry.find_identity(signed.det, now_ms)
        if identity is None:
            return Observation(state="unknown_signer", format=name, det=det, t_ms=now_ms, bound=bound)
        evidence, covers, reason = self._evidence(sam, plain)
        if not verify(identity.host_identity, signed.signature, signed.signed(evidence)):
            reason = "the signature is wrong"
        elif not signed.valid_from_ms - CLOCK_SKEW_MS <= now_ms <= signed.valid_until_ms + CLOCK_SKEW_MS:
            reason = "it is not valid at this time: a replay, or a clock that is wrong"
        if reason:
            return Observation(state="refused", format=name, det=det, t_ms=now_ms, signer=identity.name, reason=reason)
        return Observation(
            state="verified",
            format=name,
            det=det,
            t_ms=now_ms,
            signer=identity.name,
            covers_location=covers,
            bound=bound,
        )

    def _evidence(self, sam: Sam, plain: Sequence[Message]) -> tuple[bytes | None, bool, str]:
        """The evidence where it is not inside, whether a position heard is covered, and what speaks against it."""
        heard = dict(self._heard)
        if isinstance(sam, Wrapper):
            if sam.frames:
                covered = [frame for frame in sam.frames if frame[0] >> 4 == MessageType.LOCATION]
                return None, any(message_hash(frame) in heard for frame in covered), ""
            frames = sorted((encode(message) for message in plain), key=lambda frame: frame[0] >> 4)
            located = any(frame[0] >> 4 == MessageType.LOCATION for frame in frames)
            return b"".join(frames), located, "" if frames else "nothing is in the pack that it signs over"
        if isinstance(sam, Manifest):
            covers = any(heard.get(digest, False) for digest in sam.message_hashes)
            return None, covers, "" if sam.is_consistent() else "the manifest's own hash is wrong"
        return None, False, ""
