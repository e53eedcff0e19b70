"""Keys of the link and the sealing of single frames with AES-128-CCM (RFC 3610; NIST SP 800-38C), 8-octet tag."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESCCM

from wonderland.uwb.link.errors import LinkKeysError
from wonderland.uwb.link.segments import TAG_OCTETS, FrameKind

Role = Literal["pad", "uav"]
SESSION_ID_OCTETS: Final = 4
KEY_OCTETS: Final = 16
IV_OCTETS: Final = 13
MAX_SEQUENCE: Final = 0xFFFFFFFF


@dataclass(frozen=True, slots=True)
class LinkKeys:
    """Secrets of one session, from the key schedule; used for one session only. None of them shows in ``repr``.

    ``session_id`` 4 octets (on air in clear), keys 16 octets, initialisation vectors 13 octets, one of each per
    direction. Raises ``LinkKeysError``.
    """

    session_id: bytes
    key_pad_to_uav: bytes = field(repr=False)
    key_uav_to_pad: bytes = field(repr=False)
    iv_pad_to_uav: bytes = field(repr=False)
    iv_uav_to_pad: bytes = field(repr=False)

    def __post_init__(self) -> None:
        for name, size in (
            ("session_id", SESSION_ID_OCTETS),
            ("key_pad_to_uav", KEY_OCTETS),
            ("key_uav_to_pad", KEY_OCTETS),
            ("iv_pad_to_uav", IV_OCTETS),
            ("iv_uav_to_pad", IV_OCTETS),
        ):
            if len(getattr(self, name)) != size:
                raise LinkKeysError(f"{name}: {len(getattr(self, name))} octets where {size} are expected")
        if self.key_pad_to_uav == self.key_uav_to_pad:
            raise LinkKeysError("key_uav_to_pad: must differ from key_pad_to_uav")


class FrameCipher:
    """Seals or opens the frames of one direction.

    Nonce = IV ⊕ (direction octet ‖ eight zero octets ‖ sequence): the direction octet is 0 pad → UAV, 1 UAV → pad,
    with 0x80 added for acknowledgements, which count apart from data. So no nonce repeats under a key as long as no
    sequence number does. Associated data = direction octet ‖ frame header (session, sequence, index, total, addressee).
    """

    def __init__(self, keys: LinkKeys, sender: Role) -> None:
        down = sender == "pad"
        self._aead = AESCCM(keys.key_pad_to_uav if down else keys.key_uav_to_pad, tag_length=TAG_OCTETS)
        self._iv = int.from_bytes(keys.iv_pad_to_uav if down else keys.iv_uav_to_pad, "big")
        self._direction = 0 if down else 1
        self._label = bytes((self._direction,))

    def _nonce(self, kind: FrameKind, sequence: int) -> bytes:
        domain = self._direction | (0x80 if kind is FrameKind.ACKNOWLEDGEMENT else 0)
        return (self._iv ^ (domain << 96 | sequence)).to_bytes(IV_OCTETS, "big")

    def seal(self, kind: FrameKind, sequence: int, text: bytes, header: bytes) -> bytes:
        """Ciphertext and tag. The caller never passes the same kind and sequence twice."""
        return self._aead.encrypt(self._nonce(kind, sequence), text, self._label + header)

    def open(self, kind: FrameKind, sequence: int, sealed: bytes, header: bytes) -> bytes | None:
        """The plaintext, or None when the tag does not fit."""
        try:
            return self._aead.decrypt(self._nonce(kind, sequence), sealed, self._label + header)
        except InvalidTag:
            return None
