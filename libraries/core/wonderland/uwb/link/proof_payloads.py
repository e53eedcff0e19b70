"""Payloads of CLAIMS and RANGES: the records of a proof, cut to the size of a radio frame.

CLAIMS (big-endian): index of the first claim u16, then for each claim latitude i32 and longitude i32 (degrees × 10⁷),
height i32, horizontal and vertical accuracy u32 (mm), time u48 (ms since the epoch). Two fit one frame.

RANGES: flags u8 (bit 0: these are the last), index of the first round u16, then the compact form of
``wonderland.proofs.rounds``. A drone countersigns all rounds up to and with the last part, in order.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.sessions import MAX_CLAIMS, MAX_ROUNDS, Claim, RangeTable
from wonderland.proofs.rounds import pack, unpack
from wonderland.uwb.link.errors import PayloadError
from wonderland.uwb.link.segments import MAX_TEXT_OCTETS

CLAIMS_PER_FRAME: Final = 2
ROUNDS_PER_PART: Final = 40
_TABLE_OCTETS: Final = 8
"""Of a table before its first round: version, number of anchors, time."""
_INDEX: Final = struct.Struct(">H")
_CLAIM: Final = struct.Struct(">iiiIIHI")
_PART: Final = struct.Struct(">BH")
_FINAL: Final = 0x01


@dataclass(frozen=True, slots=True)
class ClaimBatch:
    """Consecutive claims of a drone; ``first_index`` counts all that it sent in this session."""

    first_index: int
    claims: tuple[Claim, ...]

    def encode(self) -> bytes:
        """2 + 26 octets for each claim; raises ``PayloadError`` beyond what a session may hold."""
        if not self.claims or self.first_index + len(self.claims) > MAX_CLAIMS:
            raise PayloadError(f"claims: {len(self.claims)} from number {self.first_index}; a session has {MAX_CLAIMS}")
        try:
            return _INDEX.pack(self.first_index) + b"".join(
                _CLAIM.pack(
                    claim.lat_e7,
                    claim.lon_e7,
                    claim.height_mm,
                    claim.accuracy_mm,
                    claim.height_accuracy_mm,
                    claim.t_ms >> 32,
                    claim.t_ms & 0xFFFFFFFF,
                )
                for claim in self.claims
            )
        except struct.error as error:
            raise PayloadError(f"claims: a value does not fit its field ({error})") from error

    @classmethod
    def decode(cls, payload: bytes) -> ClaimBatch:
        """Raises ``PayloadError`` for a wrong length or values that no claim may have."""
        body = payload[_INDEX.size :]
        if not body or len(body) % _CLAIM.size:
            raise PayloadError(f"claims: {len(payload)} octets are no whole number of claims")
        (first,) = _INDEX.unpack_from(payload)
        if first + len(body) // _CLAIM.size > MAX_CLAIMS:
            raise PayloadError(f"claims: a session has at most {MAX_CLAIMS}")
        try:
            return cls(first, tuple(_claim(*fields) for fields in _CLAIM.iter_unpack(body)))
        except ProofError as error:
            raise PayloadError(f"claims: {error}") from error


def rounds_per_frame(anchors: int) -> int:
    """How many rounds of so many anchors one frame tells."""
    return max(1, (MAX_TEXT_OCTETS - 1 - _PART.size - _TABLE_OCTETS) // (2 + 2 * anchors))


@dataclass(frozen=True, slots=True)
class RangesPart:
    """Some rounds of a session; ``final`` says that with these the table is whole."""

    first_round: int
    table: RangeTable
    final: bool

    def encode(self) -> bytes:
        """3 octets and the compact rounds; raises ``PayloadError`` for ranges that have no compact form."""
        if self.first_round + len(self.table.t_ms) > MAX_ROUNDS:
            raise PayloadError(f"ranges: a session has at most {MAX_ROUNDS} rounds")
        try:
            return _PART.pack(_FINAL if self.final else 0, self.first_round) + pack(self.table)
        except ProofError as error:
            raise PayloadError(f"ranges: {error}") from error

    @classmethod
    def decode(cls, payload: bytes, anchor_ids: Sequence[str]) -> RangesPart:
        """Raises ``PayloadError`` for bytes that are no part of a table of these anchors."""
        if len(payload) < _PART.size:
            raise PayloadError(f"ranges: {len(payload)} octets are too few")
        flags, first = _PART.unpack_from(payload)
        if flags & ~_FINAL:
            raise PayloadError(f"ranges: flags 0x{flags:02x} are unknown")
        try:
            table = unpack(payload[_PART.size :], anchor_ids)
        except ProofError as error:
            raise PayloadError(f"ranges: {error}") from error
        if first + len(table.t_ms) > MAX_ROUNDS:
            raise PayloadError(f"ranges: a session has at most {MAX_ROUNDS} rounds")
        return cls(first, table, bool(flags & _FINAL))


def _claim(*fields: int) -> Claim:
    *values, high, low = fields
    names = ("lat_e7", "lon_e7", "height_mm", "accuracy_mm", "height_accuracy_mm")
    return Claim.parse({**dict(zip(names, values, strict=True)), "t_ms": high << 32 | low})
