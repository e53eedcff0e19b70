"""What the drone says to the pad inside the link, and what it understands of the pad's words."""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from wonderland.proofs.keys import SessionKeys
from wonderland.proofs.records.sessions import Claim, Session
from wonderland.uwb.link.cipher import LinkKeys
from wonderland.uwb.link.errors import LinkError, PayloadError
from wonderland.uwb.link.link import Link, LinkAborted, MessageDelivered, MessageReceived
from wonderland.uwb.link.messages import (
    Abort,
    AbortReason,
    Echo,
    Identity,
    MessageType,
    Reply,
    decode_challenge,
    decode_code,
    encode_attested,
    encode_signature,
)
from wonderland.uwb.link.proof_payloads import ClaimBatch, RangesPart


class Word(Enum):
    """What the machine can hear."""

    POLL = "poll"
    REPLY_DELIVERED = "reply_delivered"
    SIGNATURE_DELIVERED = "signature_delivered"
    IDENTITY = "identity"
    CHALLENGE = "challenge"
    RANGES = "ranges"
    ABORT = "abort"
    BROKEN = "broken"


@dataclass(frozen=True, slots=True)
class Heard:
    """One word with what it carries; the fields that do not belong to it are empty."""

    word: Word
    octets: bytes = b""
    ranges: RangesPart | None = None
    abort: AbortReason = AbortReason.UNSPECIFIED
    reason: str = ""
    detail: str = ""


class UavWords:
    """The drone's end of the link, in terms of the proof."""

    def __init__(
        self,
        session: Session,
        keys: SessionKeys,
        anchor_ids: Sequence[str],
        *,
        certificate: bytes,
        whole_certificate: bool,
        now_ms: int,
    ) -> None:
        self._session = session
        self._code = keys.code_uav
        self._anchor_ids = tuple(anchor_ids)
        self._certificate = certificate
        self._whole_certificate = whole_certificate
        self._now_ms = now_ms
        self._link = Link(
            "uav",
            LinkKeys(
                keys.link_session, keys.key_pad_to_uav, keys.key_uav_to_pad, keys.iv_pad_to_uav, keys.iv_uav_to_pad
            ),
            lambda: self._now_ms,
        )
        self._reply_id: int | None = None
        self._signature_id: int | None = None
        self._heard: list[Heard] = []

    # --- saying ------------------------------------------------------------------------------------------------

    def reply(self, now_ms: int) -> None:
        """Step 4: the drone's session code, and who it is: its certificate's hash, or the certificate."""
        self._now_ms = now_ms
        self._reply_id = self._send(MessageType.REPLY, Reply(self._code, now_ms).encode())
        identity = (
            Identity(certificate_der=self._certificate)
            if self._whole_certificate
            else Identity(certificate_sha256=hashlib.sha256(self._certificate).digest())
        )
        self._send(MessageType.IDENTITY, identity.encode())

    def claim(self, index: int, claim: Claim, now_ms: int) -> None:
        """Where the drone says that it is now; ``index`` counts its claims of this session."""
        self._now_ms = now_ms
        try:
            payload = ClaimBatch(index, (claim,)).encode()
        except PayloadError as error:
            self._broken("claim_not_tellable", str(error))
            return
        self._send(MessageType.CLAIMS, payload)

    def echo(self, challenge: bytes, now_ms: int) -> None:
        """The pad's challenge, and when it was heard."""
        self._now_ms = now_ms
        self._send(MessageType.ECHO, Echo(challenge, now_ms).encode())

    def attest(self, digests: Sequence[bytes], now_ms: int) -> None:
        """Step 6: the digests of its Remote ID positions, which the countersignature covers."""
        self._now_ms = now_ms
        self._send(MessageType.ATTESTED, encode_attested(digests))

    def countersign(self, signature: bytes, now_ms: int) -> None:
        """Step 6: r ‖ s over the statement."""
        self._now_ms = now_ms
        self._signature_id = self._send(MessageType.SIGNATURE, encode_signature(signature))

    def abort(self, reason: AbortReason, text: str, now_ms: int) -> None:
        """Tell the pad why the drone gives up."""
        self._now_ms = now_ms
        self._send(MessageType.ABORT, Abort(reason, text[:60]).encode())

    @property
    def idle(self) -> bool:
        """Nothing waits to be sent or acknowledged."""
        return self._link.idle or self._link.closed

    def close(self) -> None:
        """Forget what still waits."""
        self._link.close()

    def frames_to_send(self, now_ms: int, budget: int) -> list[bytes]:
        """Frames for the node."""
        self._now_ms = now_ms
        return self._link.frames_to_send(budget)

    def next_wakeup_ms(self) -> int | None:
        """When ``frames_to_send`` has something again."""
        return self._link.next_wakeup_ms()

    # --- hearing -----------------------------------------------------------------------------------------------

    def receive(self, data: bytes, now_ms: int) -> None:
        """A data unit from the node."""
        self._now_ms = now_ms
        self._link.receive(data)

    def heard(self) -> list[Heard]:
        """What was understood since the last call, in order."""
        for event in self._link.events():
            match event:
                case MessageDelivered(message_id) if message_id == self._reply_id:
                    self._heard.append(Heard(Word.REPLY_DELIVERED))
                case MessageDelivered(message_id) if message_id == self._signature_id:
                    self._heard.append(Heard(Word.SIGNATURE_DELIVERED))
                case MessageReceived():
                    self._understand(event)
                case LinkAborted(cause, detail):
                    self._broken(f"link_{cause.value}", detail)
                case _:
                    pass
        out, self._heard = self._heard, []
        return out

    def _understand(self, message: MessageReceived) -> None:
        try:
            self._heard.append(self._meaning(message.message_type, message.payload))
        except PayloadError as error:
            self._broken("malformed_message", str(error))

    def _meaning(self, message_type: int, payload: bytes) -> Heard:
        match message_type:
            case MessageType.POLL:
                return Heard(Word.POLL, decode_code(payload))
            case MessageType.IDENTITY:
                return self._identity(Identity.decode(payload))
            case MessageType.CHALLENGE:
                return Heard(Word.CHALLENGE, decode_challenge(payload))
            case MessageType.RANGES:
                return Heard(Word.RANGES, ranges=RangesPart.decode(payload, self._anchor_ids))
            case MessageType.ABORT:
                abort = Abort.decode(payload)
                return Heard(Word.ABORT, abort=abort.reason, detail=abort.text)
            case _:
                return Heard(
                    Word.BROKEN, reason="unknown_message", detail=f"message type {message_type} is not for a drone"
                )

    def _identity(self, identity: Identity) -> Heard:
        said = identity.certificate_sha256 or hashlib.sha256(identity.certificate_der or b"").digest()
        if hmac.compare_digest(said.hex(), self._session.pad.certificate_sha256):
            return Heard(Word.IDENTITY, said)
        return Heard(
            Word.BROKEN, reason="identity_mismatch", detail="the pad's certificate is not the one that gave the prekey"
        )

    def _send(self, message_type: MessageType, payload: bytes) -> int | None:
        try:
            return self._link.send(message_type, payload)
        except LinkError as error:
            self._broken("link_closed", str(error))
            return None

    def _broken(self, reason: str, detail: str) -> None:
        self._heard.append(Heard(Word.BROKEN, reason=reason, detail=detail))
