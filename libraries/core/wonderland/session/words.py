"""One end of the link in terms of the proof: what is said to the other side, and what is understood of it."""

from __future__ import annotations

import hashlib
import hmac
from dataclasses import dataclass
from enum import Enum
from typing import Final, Literal

from wonderland.proofs.keys import SessionKeys
from wonderland.uwb.link.cipher import LinkKeys
from wonderland.uwb.link.errors import LinkError, PayloadError
from wonderland.uwb.link.link import Link, LinkAborted, MessageDelivered, MessageReceived
from wonderland.uwb.link.messages import Abort, AbortReason, Identity, MessageType
from wonderland.uwb.link.proof_payloads import ClaimBatch, RangesPart
from wonderland.uwb.link.segments import MAX_FRAME_OCTETS

DELIVERY_MS: Final = 10_000
"""Longest that a message stays unacknowledged in rounds of the usual length."""
REPEAT_MS: Final = 250
"""After which a segment is repeated in such rounds: two slow ones and a half."""


class Word(Enum):
    """What a machine can hear. ``…_SENT`` and ``…_DELIVERED`` are of its own words."""

    POLL = "poll"
    POLL_SENT = "poll_sent"
    POLL_DELIVERED = "poll_delivered"
    REPLY = "reply"
    REPLY_DELIVERED = "reply_delivered"
    IDENTITY = "identity"
    CHALLENGE = "challenge"
    ECHO = "echo"
    CLAIMS = "claims"
    RANGES = "ranges"
    ATTESTED = "attested"
    SIGNATURE = "signature"
    SIGNATURE_DELIVERED = "signature_delivered"
    ABORT = "abort"
    BROKEN = "broken"


@dataclass(frozen=True, slots=True)
class Heard:
    """One word with what it carries; the fields that do not belong to it are empty."""

    word: Word
    octets: bytes = b""
    t_ms: int = 0
    """When the pad sent it (POLL_SENT, by its clock), or the drone says that it did (REPLY, ECHO, by the drone's)."""
    claims: ClaimBatch | None = None
    ranges: RangesPart | None = None
    digests: tuple[bytes, ...] = ()
    abort: AbortReason = AbortReason.UNSPECIFIED
    reason: str = ""
    detail: str = ""


class Words:
    """The end of one side; ``PadWords`` and ``UavWords`` add what only they say and understand."""

    def __init__(
        self,
        side: Literal["pad", "uav"],
        keys: SessionKeys,
        *,
        certificate: bytes,
        whole_certificate: bool,
        other_sha256: str,
        now_ms: int,
        word_octets: int,
        pace: float = 1.0,
    ) -> None:
        """``certificate`` (DER) is this side's; ``other_sha256`` that of the one which the session names (hex).

        ``word_octets``: data that one radio frame takes. ``pace``: how many times longer than usual rounds take.
        """
        self._side = side
        self._certificate = certificate
        self._whole_certificate = whole_certificate
        self._other_sha256 = other_sha256
        self._now_ms = now_ms
        self._word_octets = word_octets
        self._link = Link(
            side,
            LinkKeys(
                keys.link_session, keys.key_pad_to_uav, keys.key_uav_to_pad, keys.iv_pad_to_uav, keys.iv_uav_to_pad
            ),
            lambda: self._now_ms,
            frame_octets=min(MAX_FRAME_OCTETS, word_octets),
            delivery_timeout_ms=round(pace * DELIVERY_MS),
            retransmit_after_ms=round(pace * REPEAT_MS),
        )
        self._awaited: dict[int, Word] = {}
        self._heard: list[Heard] = []

    def introduce(self, now_ms: int) -> None:
        """Who this side is: its certificate's hash, or the certificate."""
        self._now_ms = now_ms
        identity = (
            Identity(certificate_der=self._certificate)
            if self._whole_certificate
            else Identity(certificate_sha256=hashlib.sha256(self._certificate).digest())
        )
        self._send(MessageType.IDENTITY, identity.encode())

    def abort(self, reason: AbortReason, now_ms: int, text: str = "") -> None:
        """Tell the other side that this one gives up, and why (60 characters at most are sent)."""
        self._now_ms = now_ms
        self._send(MessageType.ABORT, Abort(reason, text[:60]).encode())

    def close(self) -> None:
        """Forget what still waits."""
        self._link.close()

    @property
    def idle(self) -> bool:
        """Nothing waits to be sent or acknowledged."""
        return self._link.idle or self._link.closed

    def frames_to_send(self, now_ms: int) -> list[bytes]:
        """Frames for one data unit of the node."""
        self._now_ms = now_ms
        return self._link.frames_to_send(self._word_octets)

    def next_wakeup_ms(self) -> int | None:
        """When ``frames_to_send`` has something again."""
        return self._link.next_wakeup_ms()

    def receive(self, data: bytes, now_ms: int) -> None:
        """A data unit from a node."""
        self._now_ms = now_ms
        self._link.receive(data)

    def heard(self) -> list[Heard]:
        """What was understood since the last call, in order."""
        for event in self._link.events():
            match event:
                case MessageDelivered(message_id):
                    delivered = self._awaited.pop(message_id, None)
                    if delivered is not None:
                        self._heard.append(Heard(delivered))
                case MessageReceived():
                    self._receive_message(event)
                case LinkAborted(cause, detail):
                    self._broken(f"link_{cause.value}", detail)
        out, self._heard = self._heard, []
        return out

    def _understand(self, message_type: int, payload: bytes) -> Heard | None:
        """A message that only this side understands; None for others. Raises PayloadError."""
        raise NotImplementedError

    def _receive_message(self, message: MessageReceived) -> None:
        try:
            heard = self._meaning(message.message_type, message.payload)
        except PayloadError as error:
            self._broken("malformed_message", str(error))
        else:
            self._heard.append(heard)

    def _meaning(self, message_type: int, payload: bytes) -> Heard:
        match message_type:
            case MessageType.IDENTITY:
                return self._identity(Identity.decode(payload))
            case MessageType.ABORT:
                abort = Abort.decode(payload)
                return Heard(Word.ABORT, abort=abort.reason, detail=abort.text)
            case _:
                side = "pad" if self._side == "pad" else "drone"
                return self._understand(message_type, payload) or Heard(
                    Word.BROKEN, reason="unknown_message", detail=f"message type {message_type} is not for a {side}"
                )

    def _identity(self, identity: Identity) -> Heard:
        said = identity.certificate_sha256 or hashlib.sha256(identity.certificate_der or b"").digest()
        if hmac.compare_digest(said.hex(), self._other_sha256):
            return Heard(Word.IDENTITY, said)
        other = "drone's certificate is not the one that asked"
        if self._side == "uav":
            other = "pad's certificate is not the one that gave the prekey"
        return Heard(Word.BROKEN, reason="identity_mismatch", detail=f"the {other}")

    def _send(self, message_type: MessageType, payload: bytes, delivered: Word | None = None) -> None:
        """Queue a message; ``delivered`` is heard once the other side has it."""
        try:
            message_id = self._link.send(message_type, payload)
        except LinkError as error:
            self._broken("link_closed", str(error))
        else:
            if delivered is not None:
                self._awaited[message_id] = delivered

    def _broken(self, reason: str, detail: str) -> None:
        self._heard.append(Heard(Word.BROKEN, reason=reason, detail=detail))
