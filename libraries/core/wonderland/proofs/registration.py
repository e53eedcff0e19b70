"""An operator's registration number beside the ledger: the ledger has a commitment, whoever holds the number opens it.

The commitment is the SHA-256 of the opening's canonical JSON. So an opening in a file of exactly those bytes is checked
against the ledger's record with `sha256sum` alone. The serial number is within, so that no drone's opening is another
one's. What keeps a number secret from somebody who tries all numbers of a country is the salt.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from wonderland.proofs import encoding
from wonderland.proofs.errors import RecordError
from wonderland.proofs.records.fields import UavId
from wonderland.proofs.records.schema import Choice, Record, Text
from wonderland.proofs.records.uavs import normalised_registration

TYPE: Final = "wonderland-registration-1"
SALT_BYTES: Final = 32
_MIN_DISTINCT: Final = 12
"""Of 32 random bytes, fewer than 12 different ones come once in 10²⁰: whoever sends such a salt did not draw it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Opening(Record):
    """What opens the commitment of a drone's record: to be kept, and shown to whoever may know the number."""

    type: Annotated[str, Choice((TYPE,), "What this is, so that nothing else has its hash")] = TYPE
    uav_id: UavId
    registration: Annotated[
        str, Text(32, r"[A-Za-z0-9-]+", "Operator registration number, as it is normalised", min_length=1)
    ]
    salt: Annotated[str, Text(64, r"[0-9a-f]{64}", "32 random bytes, lower-case hexadecimal")]

    @classmethod
    def of(cls, uav_id: str, registration: str, salt: bytes) -> Opening:
        """The opening of a number, normalised. `salt`: 32 fresh bytes of a generator of secrets. Raises RecordError."""
        return cls.parse(
            {"type": TYPE, "uav_id": uav_id, "registration": normalised_registration(registration), "salt": salt.hex()}
        )

    def validate(self, path: str) -> None:
        """One spelling, no secret, and a salt that somebody drew."""
        prefix = f"{path}." if path else ""
        if normalised_registration(self.registration) != self.registration:
            raise RecordError(
                f"{prefix}registration",
                "is not as it is committed to: three capitals, then small letters and digits, "
                "without the dash and the operator's secret after it",
            )
        if len(set(bytes.fromhex(self.salt))) < _MIN_DISTINCT:
            raise RecordError(f"{prefix}salt", "is not random: draw 32 bytes from a generator of secrets")

    @property
    def commitment(self) -> str:
        """What the ledger's record has: SHA-256 of the canonical JSON, lower-case hexadecimal."""
        return encoding.digest(self.to_json()).hex()

    def __repr__(self) -> str:
        """Without the number and the salt: a repr ends up in logs."""
        return f"Opening(uav_id={self.uav_id!r})"
