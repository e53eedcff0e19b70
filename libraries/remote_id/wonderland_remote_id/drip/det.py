"""DRIP entity tags: IPv6 addresses that are hashes of a public key and of the registry's place (RFC 9374)."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from typing import Final

from wonderland_remote_id.errors import RemoteIdError

BYTES: Final = 16
HOST_IDENTITY_BYTES: Final = 32
EDDSA_CSHAKE128: Final = 5
SESSION_ID_TYPE: Final = 1
"""The first byte of a specific session id that is a DRIP entity tag."""
_PREFIX: Final = 0x2001003
_CONTEXT: Final = bytes.fromhex("00b5a69c795df5d5f0087f56843f2c40")
_BASE32: Final = "0123456789ABCDEFGHJKLMNPQRTUVWXY"
_MESSAGE_HASH: Final = b"Remote ID Auth Hash"


class DripError(RemoteIdError):
    """An entity tag, an authentication payload or a registry that is not as it must be."""


@dataclass(frozen=True, slots=True)
class Det:
    """An entity tag, 16 bytes."""

    octets: bytes

    def __post_init__(self) -> None:
        if len(self.octets) != BYTES or int.from_bytes(self.octets[:4], "big") >> 4 != _PREFIX:
            raise DripError(f"{self.octets.hex()[:40]} is no DRIP entity tag: it is not of 2001:30::/28")

    @classmethod
    def parse(cls, text: str) -> Det:
        """From the text of an IPv6 address. Raises `DripError`."""
        try:
            return cls(ipaddress.IPv6Address(text).packed)
        except ValueError:
            raise DripError(f"{text!r:.60} is no IPv6 address") from None

    @classmethod
    def of(cls, host_identity: bytes, *, raa: int, hda: int) -> Det:
        """The tag of an Ed25519 public key (32 bytes) with a registry's numbers, each below 16384."""
        if not (0 <= raa < 1 << 14 and 0 <= hda < 1 << 14):
            raise DripError(f"RAA {raa} or HDA {hda} is outside 0..16383")
        head = (_PREFIX << 36 | raa << 22 | hda << 8 | EDDSA_CSHAKE128).to_bytes(8, "big")
        return cls(head + _orchid_hash(head, host_identity))

    @classmethod
    def of_session_id(cls, uas_id: str) -> Det | None:
        """The tag in a Basic ID of type specific session; None where the session id is of another kind."""
        try:
            octets = bytes.fromhex(uas_id)
            return cls(octets[1:17]) if len(octets) == 20 and octets[0] == SESSION_ID_TYPE else None
        except (ValueError, DripError):
            return None

    @property
    def raa(self) -> int:
        """The registered assigning authority: usually a country's."""
        return int.from_bytes(self.octets[:8], "big") >> 22 & 0x3FFF

    @property
    def hda(self) -> int:
        """The domain authority below it: who registered the drone."""
        return int.from_bytes(self.octets[:8], "big") >> 8 & 0x3FFF

    def is_below(self, parent: Det) -> bool:
        """Whether ``parent`` may endorse this tag: the apex RAAs, an RAA its HDAs, an HDA those of its own numbers."""
        if parent.hda:
            return (self.raa, self.hda) == (parent.raa, parent.hda)
        return self.raa == parent.raa or (parent.raa == 0 and self.hda == 0)

    def is_authority_under(self, parent: Det) -> bool:
        """Whether ``parent``'s endorsement makes it a registry: below the apex an RAA (HDA 0), below an RAA an HDA."""
        if parent.hda:
            return False
        return self.hda != 0 if parent.raa else self.raa != 0

    @property
    def suite(self) -> int:
        """How key and hash are made; 5 is EdDSA with cSHAKE128."""
        return self.octets[7]

    @property
    def session_id(self) -> str:
        """As the UAS id of a Basic ID of type specific session."""
        return (bytes((SESSION_ID_TYPE,)) + self.octets + bytes(3)).hex()

    def serial_number(self, manufacturer: str) -> str:
        """As a serial number of ANSI/CTA-2063-A (RFC 9374, 4.2), which keeps the lower 72 bits."""
        low = int.from_bytes(self.octets[7:], "big")
        return manufacturer + "F" + "".join(_BASE32[low >> 5 * place & 31] for place in range(14, -1, -1))

    def names(self, uas_id: str) -> bool:
        """Whether an identity that is broadcast is this tag: as a session id, or in a serial number made from it."""
        return uas_id == self.session_id or uas_id[4:] == self.serial_number("0000")[4:]

    def belongs_to(self, host_identity: bytes) -> bool:
        """Whether the tag is the hash of this public key."""
        if self.suite != EDDSA_CSHAKE128 or len(host_identity) != HOST_IDENTITY_BYTES:
            return False
        return _orchid_hash(self.octets[:8], host_identity) == self.octets[8:]

    def __str__(self) -> str:
        return str(ipaddress.IPv6Address(self.octets))


def _orchid_hash(head: bytes, host_identity: bytes) -> bytes:
    return cshake128(head + host_identity, _CONTEXT, 8)


def message_hash(message: bytes) -> bytes:
    """The hash of a broadcast message in a Manifest (RFC 9575, 4.4.3), 8 bytes."""
    return cshake128(message, _MESSAGE_HASH, 8)


def cshake128(data: bytes, customisation: bytes, size: int) -> bytes:
    """NIST SP 800-185. Raises `DripError` where pycryptodome is missing."""
    try:
        from Crypto.Hash import cSHAKE128  # noqa: PLC0415 - an extra: who does not use DRIP need not have it
    except ModuleNotFoundError:
        raise DripError("DRIP needs cSHAKE128; pip install 'wonderland-remote-id[drip]'") from None
    return bytes(cSHAKE128.new(data, custom=customisation).read(size))
