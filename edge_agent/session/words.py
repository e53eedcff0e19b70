"""What the pad says to the drone inside the link, and what it understands of the answers."""

from __future__ import annotations

import hashlib
import hmac
from dataclasses import dataclass
from enum import Enum
from typing import Final

from cryptography.hazmat.primitives.asymmetric import ec

from edge_agent.session.evidence import GatheredEvidence
from wonderland.ledger.errors import SignatureError
from wonderland.ledger.signing import der_from_raw, verify
from wonderland.proofs.encoding import from_base64url
from wonderland.proofs.keys import SessionKeys
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.statement import statement
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
    decode_attested,
    decode_signature,
    encode_challenge,
    encode_code,
)
from wonderland.uwb.link.proof_payloads import ROUNDS_PER_PART, ClaimBatch, RangesPart


class Word(Enum):
    """What the machine can hear."""

    POLL_SENT = "poll_sent"
    POLL_DELIVERED = "poll_delivered"
    REPLY = "reply"
    IDENTITY = "identity"
    CLAIMS = "claims"
    ECHO = "echo"
    ATTESTED = "attested"
    SIGNATURE = "signature"
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
    digests: tuple[bytes, ...] = ()
    abort: AbortReason = AbortReason.UNSPECIFIED
    reason: str = ""
    detail: str = ""


class PadWords:
    """The pad's end of the link, in terms of the proof."""

    def __init__(
        self, session: Session, keys: SessionKeys, *, certificate: bytes, whole_certificate: bool, now_ms: int
    ) -> None:
        self._session = session
        self._code = keys.code_pad
        self._certificate = certificate
        self._whole_certificate = whole_certificate
        self._now_ms = now_ms
        self._link = Link(
            "pad",
            LinkKeys(
                keys.link_session, keys.key_pad_to_uav, keys.key_uav_to_pad, keys.iv_pad_to_uav, keys.iv_uav_to_pad
            ),
            lambda: self._now_ms,
        )
        self._poll_id: int | None = None
        self._poll_sent = False
        self._told = 0
        self._heard: list[Heard] = []

    # --- saying ------------------------------------------------------------------------------------------------

    def poll(self, now_ms: int) -> None:
        """Step 2: the pad's session code."""
        self._now_ms = now_ms
        self._poll_id = self._send(MessageType.POLL, encode_code(self._code))

    def introduce(self, now_ms: int) -> None:
        """Who the pad is: its certificate's hash, or the certificate."""
        self._now_ms = now_ms
        identity = (
            Identity(certificate_der=self._certificate)
            if self._whole_certificate
            else Identity(certificate_sha256=hashlib.sha256(self._certificate).digest())
        )
        self._send(MessageType.IDENTITY, identity.encode())

    def challenge(self, challenge: bytes, now_ms: int) -> None:
        """Eight octets that nobody could know before."""
        self._now_ms = now_ms
        self._send(MessageType.CHALLENGE, encode_challenge(challenge))

    def tell(self, gathered: GatheredEvidence, now_ms: int, *, final: bool) -> None:
        """Ranges that the drone was not told yet; with ``final`` it learns that these are all."""
        self._now_ms = now_ms
        while True:
            stop = min(self._told + ROUNDS_PER_PART, gathered.rounds)
            last = final and stop == gathered.rounds
            if stop == self._told and not last:
                return
            try:
                payload = RangesPart(self._told, gathered.table(self._told, stop), last).encode()
            except PayloadError as error:
                self._broken("ranges_not_tellable", str(error))
                return
            self._send(MessageType.RANGES, payload)
            self._told = stop
            if last or stop == gathered.rounds:
                return

    def abort(self, reason: AbortReason, now_ms: int) -> None:
        """Tell the drone that the pad gives up."""
        self._now_ms = now_ms
        self._send(MessageType.ABORT, Abort(reason).encode())

    def close(self) -> None:
        """Forget what still waits."""
        self._link.close()

    def frames_to_send(self, now_ms: int, budget: int) -> list[bytes]:
        """Frames for the node."""
        self._now_ms = now_ms
        frames = self._link.frames_to_send(budget)
        if frames and self._poll_id is not None and not self._poll_sent:
            self._poll_sent = True
            self._heard.append(Heard(Word.POLL_SENT, t_ms=now_ms))
        return frames

    def next_wakeup_ms(self) -> int | None:
        """When ``frames_to_send`` has something again."""
        return self._link.next_wakeup_ms()

    # --- hearing -----------------------------------------------------------------------------------------------

    def receive(self, data: bytes, now_ms: int) -> None:
        """A data unit from a node."""
        self._now_ms = now_ms
        self._link.receive(data)

    def heard(self) -> list[Heard]:
        """What was understood since the last call, in order."""
        for event in self._link.events():
            match event:
                case MessageDelivered(message_id) if message_id == self._poll_id:
                    self._heard.append(Heard(Word.POLL_DELIVERED))
                case MessageReceived():
                    self._understand(event)
                case LinkAborted(cause, detail):
                    self._broken(f"link_{cause.value}", detail)
                case _:
                    pass
        out, self._heard = self._heard, []
        return out

    def signature_holds(self, signature: bytes, gathered: GatheredEvidence) -> bool:
        """Whether the drone's countersignature (r ‖ s, 64 B) fits the ranges told and what the drone said."""
        public_key = self._session.uav.public_key
        if public_key is None:
            return False
        text = statement(
            self._session.session_id,
            self._session.transcript_sha256,
            gathered.table(),
            gathered.claims,
            gathered.attested,
        )
        try:
            key = ec.EllipticCurvePublicKey.from_encoded_point(ec.SECP256R1(), from_base64url(public_key))
            verify(key, text, der_from_raw(signature))
        except (SignatureError, ValueError):
            return False
        return True

    def _understand(self, message: MessageReceived) -> None:
        try:
            self._heard.append(self._meaning(message.message_type, message.payload))
        except PayloadError as error:
            self._broken("malformed_message", str(error))

    def _meaning(self, message_type: int, payload: bytes) -> Heard:
        match message_type:
            case MessageType.REPLY:
                reply = Reply.decode(payload)
                return Heard(Word.REPLY, reply.code, reply.matched_ms)
            case MessageType.CLAIMS:
                return Heard(Word.CLAIMS, claims=ClaimBatch.decode(payload))
            case MessageType.IDENTITY:
                return self._identity(Identity.decode(payload))
            case MessageType.ECHO:
                echo = Echo.decode(payload)
                return Heard(Word.ECHO, echo.challenge, echo.heard_ms)
            case MessageType.ATTESTED:
                return Heard(Word.ATTESTED, digests=decode_attested(payload))
            case MessageType.SIGNATURE:
                return Heard(Word.SIGNATURE, decode_signature(payload))
            case MessageType.ABORT:
                abort = Abort.decode(payload)
                return Heard(Word.ABORT, abort=abort.reason, detail=abort.text)
            case _:
                return Heard(
                    Word.BROKEN, reason="unknown_message", detail=f"message type {message_type} is not for a pad"
                )

    def _identity(self, identity: Identity) -> Heard:
        said = identity.certificate_sha256 or hashlib.sha256(identity.certificate_der or b"").digest()
        if hmac.compare_digest(said.hex(), self._session.uav.certificate_sha256):
            return Heard(Word.IDENTITY, said)
        return Heard(
            Word.BROKEN, reason="identity_mismatch", detail="the drone's certificate is not the one that asked"
        )

    def _send(self, message_type: MessageType, payload: bytes) -> int | None:
        try:
            return self._link.send(message_type, payload)
        except LinkError as error:
            self._broken("link_closed", str(error))
            return None

    def _broken(self, reason: str, detail: str) -> None:
        self._heard.append(Heard(Word.BROKEN, reason=reason, detail=detail))


__all__: Final = ["Heard", "PadWords", "Word"]
