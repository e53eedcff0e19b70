"""Fields that several messages share, with their bounds; those that records have too take them from there."""

from __future__ import annotations

import re
from typing import Annotated, Any, Final, Literal, TypeAlias, TypeVar

from msgspec import Meta, Struct, field

from wonderland.proofs.records import fields
from wonderland.proofs.records.schema import Integer, Text

MAX_SEQ: Final = 2**53 - 1
_NO_CONTROLS: Final = r"^[^\x00-\x1f\x7f]*\Z"
"""`\\Z` throughout: `$` also matches before a line feed at the end."""

_UNSAYABLE: Final = re.compile(r"[\x00-\x1f\x7f\ud800-\udfff]")

_Value = TypeVar("_Value")


class Message(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """Base of all that agents say. What is None is left out; a field that nobody knows is refused."""


def clean(text: str, most: int) -> str:
    """A text of somebody else's making as a message can carry it: at most ``most`` characters, no control characters.

    Those, and halves of surrogate pairs (which undecodable file names have), become U+FFFD.
    """
    return _UNSAYABLE.sub("\ufffd", text[:most])


def said(value: _Value) -> _Value:
    """A field's default that is written all the same: only plain defaults are left out."""
    default: _Value = field(default_factory=lambda: value)
    return default


def _text(of: Any) -> Meta:
    """The bounds of a record's text field."""
    (spec,) = [each for each in of.__metadata__ if isinstance(each, Text)]
    return Meta(
        min_length=spec.min_length,
        max_length=spec.max_length,
        pattern=rf"^(?:{spec.pattern})\Z",
        description=spec.description,
    )


def _integer(of: Any) -> Meta:
    (spec,) = [each for each in of.__metadata__ if isinstance(each, Integer)]
    return Meta(ge=spec.minimum, le=spec.maximum, description=spec.description)


PadId = Annotated[str, _text(fields.PadId)]
UavId = Annotated[str, _text(fields.UavId)]
AnchorId = Annotated[str, _text(fields.AnchorId)]
SessionId = Annotated[str, _text(fields.SessionId)]
MspId = Annotated[str, _text(fields.MspId)]
TimeMs = Annotated[int, _integer(fields.TimeMs)]
LatE7 = Annotated[int, _integer(fields.LatE7)]
LonE7 = Annotated[int, _integer(fields.LonE7)]
HeightMm = Annotated[int, _integer(fields.HeightMm)]
LocalMm = Annotated[int, _integer(fields.LocalMm)]
Ppm = Annotated[int, _integer(fields.Ppm)]

AgentId = Annotated[str, Meta(min_length=1, max_length=64, pattern=rf"^(?:{fields.ID_PATTERN})\Z")]
Hex32 = Annotated[str, Meta(pattern=r"^[0-9a-f]{32}\Z", description="32 hexadecimal digits")]
TxId = Annotated[str, Meta(pattern=r"^[0-9a-f]{64}\Z", description="Transaction id, 64 hexadecimal digits")]
EndPoint = Annotated[str, Meta(pattern=r"^(?:[0-9a-f]{64})?\Z")]
Base64url = Annotated[str, Meta(min_length=8, max_length=128, pattern=r"^[A-Za-z0-9_-]*\Z", description="Base64url")]
Seq = Annotated[int, Meta(ge=1, le=MAX_SEQ, description="Number in its spool")]
Count = Annotated[int, Meta(ge=0, le=2**53)]
Some = Annotated[int, Meta(ge=0, le=MAX_SEQ)]
Length = Annotated[int, Meta(ge=0, le=2**40)]
Mm2 = Annotated[int, Meta(ge=-(2**52), le=2**52)]
AccuracyMm = Annotated[int, Meta(ge=0, le=100_000_000, description="95 %")]
AboveMm = Annotated[int, Meta(ge=-2_000_000, le=100_000_000)]
ShiftMm = Annotated[int, Meta(ge=0, le=100_000)]

Text23 = Annotated[str, Meta(max_length=23, pattern=_NO_CONTROLS)]
Text24 = Annotated[str, Meta(max_length=24, pattern=_NO_CONTROLS)]
Text32 = Annotated[str, Meta(max_length=32, pattern=_NO_CONTROLS)]
Text64 = Annotated[str, Meta(max_length=64, pattern=_NO_CONTROLS)]
Text200 = Annotated[str, Meta(max_length=200, pattern=_NO_CONTROLS)]
Text300 = Annotated[str, Meta(max_length=300, pattern=_NO_CONTROLS)]
Text500 = Annotated[str, Meta(max_length=500, pattern=_NO_CONTROLS)]

Action: TypeAlias = Literal["land", "takeoff", "dock"]
StepName: TypeAlias = Literal["request", "poll", "match", "reply", "range", "confirm", "verdict", "permission"]
FindingKind: TypeAlias = Literal[
    "two_places",
    "impossible_speed",
    "time_stuck",
    "time_backwards",
    "time_off",
    "several_identities",
    "rate_high",
    "signature_bad",
]
DescriptionName: TypeAlias = Literal["text", "emergency", "extended_status", "private"]
Above: TypeAlias = Literal["takeoff", "ground"]
OperatorPlace: TypeAlias = Literal["takeoff", "live_gnss", "fixed"]
AnchorCondition: TypeAlias = Literal["up", "down", "silent"]
DriftCondition: TypeAlias = Literal["ok", "drifting", "moved"]
