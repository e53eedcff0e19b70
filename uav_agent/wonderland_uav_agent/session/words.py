"""What the drone says to the pad inside the link, and what it understands of the pad's words."""

from __future__ import annotations

from collections.abc import Sequence

from wonderland.proofs.keys import SessionKeys
from wonderland.proofs.records.sessions import Claim, Session
from wonderland.session.words import Heard, Word, Words
from wonderland.uwb.link.errors import PayloadError
from wonderland.uwb.link.messages import (
    Echo,
    MessageType,
    Reply,
    decode_challenge,
    decode_code,
    encode_attested,
    encode_signature,
)
from wonderland.uwb.link.proof_payloads import ClaimBatch, RangesPart


class UavWords(Words):
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
        word_octets: int,
        pace: float = 1.0,
    ) -> None:
        super().__init__(
            "uav",
            keys,
            certificate=certificate,
            whole_certificate=whole_certificate,
            other_sha256=session.pad.certificate_sha256,
            now_ms=now_ms,
            word_octets=word_octets,
            pace=pace,
        )
        self._code = keys.code_uav
        self._anchor_ids = tuple(anchor_ids)

    def reply(self, now_ms: int) -> None:
        """Step 4: the drone's session code, and who it is."""
        self._now_ms = now_ms
        self._send(MessageType.REPLY, Reply(self._code, now_ms).encode(), Word.REPLY_DELIVERED)
        self.introduce(now_ms)

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
        self._send(MessageType.SIGNATURE, encode_signature(signature), Word.SIGNATURE_DELIVERED)

    def _understand(self, message_type: int, payload: bytes) -> Heard | None:
        match message_type:
            case MessageType.POLL:
                return Heard(Word.POLL, decode_code(payload))
            case MessageType.CHALLENGE:
                return Heard(Word.CHALLENGE, decode_challenge(payload))
            case MessageType.RANGES:
                return Heard(Word.RANGES, ranges=RangesPart.decode(payload, self._anchor_ids))
            case _:
                return None
