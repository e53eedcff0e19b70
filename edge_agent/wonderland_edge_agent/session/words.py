"""What the pad says to the drone inside the link, and what it understands of the answers."""

from __future__ import annotations

from cryptography.hazmat.primitives.asymmetric import ec

from wonderland.proofs.encoding import from_base64url
from wonderland.proofs.keys import SessionKeys
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.statement import statement
from wonderland.session.words import Heard, Word, Words
from wonderland.uwb.link.errors import PayloadError
from wonderland.uwb.link.messages import (
    Echo,
    MessageType,
    Reply,
    decode_attested,
    decode_signature,
    encode_challenge,
    encode_code,
)
from wonderland.uwb.link.proof_payloads import ROUNDS_PER_PART, ClaimBatch, RangesPart, rounds_per_frame
from wonderland_edge_agent.session.evidence import GatheredEvidence
from wonderland_fabric_gateway.errors import SignatureError
from wonderland_fabric_gateway.signing import der_from_raw, verify


class PadWords(Words):
    """The pad's end of the link, in terms of the proof."""

    def __init__(
        self,
        session: Session,
        keys: SessionKeys,
        *,
        certificate: bytes,
        whole_certificate: bool,
        now_ms: int,
        word_octets: int,
        pace: float = 1.0,
    ) -> None:
        super().__init__(
            "pad",
            keys,
            certificate=certificate,
            whole_certificate=whole_certificate,
            other_sha256=session.uav.certificate_sha256,
            now_ms=now_ms,
            word_octets=word_octets,
            pace=pace,
        )
        self._session = session
        self._code = keys.code_pad
        self._polled = self._poll_sent = False
        self._told = 0

    def poll(self, now_ms: int) -> None:
        """Step 2: the pad's session code."""
        self._now_ms = now_ms
        self._polled = True
        self._send(MessageType.POLL, encode_code(self._code), Word.POLL_DELIVERED)

    def challenge(self, challenge: bytes, now_ms: int) -> None:
        """Eight octets that nobody could know before."""
        self._now_ms = now_ms
        self._send(MessageType.CHALLENGE, encode_challenge(challenge))

    def tell(self, gathered: GatheredEvidence, now_ms: int, *, final: bool) -> None:
        """Ranges that the drone was not told yet, once they fill a frame; ``final``: it learns that these are all."""
        if not final and gathered.rounds < self._told + rounds_per_frame(len(gathered.anchor_ids)):
            return
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

    def frames_to_send(self, now_ms: int) -> list[bytes]:
        """Frames for the node; POLL_SENT is heard with the first ones after ``poll``."""
        frames = super().frames_to_send(now_ms)
        if frames and self._polled and not self._poll_sent:
            self._poll_sent = True
            self._heard.append(Heard(Word.POLL_SENT, t_ms=now_ms))
        return frames

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

    def _understand(self, message_type: int, payload: bytes) -> Heard | None:
        match message_type:
            case MessageType.REPLY:
                reply = Reply.decode(payload)
                return Heard(Word.REPLY, reply.code, reply.matched_ms)
            case MessageType.CLAIMS:
                return Heard(Word.CLAIMS, claims=ClaimBatch.decode(payload))
            case MessageType.ECHO:
                echo = Echo.decode(payload)
                return Heard(Word.ECHO, echo.challenge, echo.heard_ms)
            case MessageType.ATTESTED:
                return Heard(Word.ATTESTED, digests=decode_attested(payload))
            case MessageType.SIGNATURE:
                return Heard(Word.SIGNATURE, decode_signature(payload))
            case _:
                return None
