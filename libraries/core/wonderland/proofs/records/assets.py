"""The paper's generic data structure: any message of any type, kept with its history."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from wonderland.proofs.records.fields import MspId, Sha256Hex, TimeMs
from wonderland.proofs.records.schema import Flag, Integer, Record, Text

MAX_VALUE_CHARACTERS = 512 * 1024

AssetId = Annotated[
    str, Text(128, "[^\x00-\x1f\x7f\U0010ffff]+", "Identifier of the asset, unique in the channel", min_length=1)
]
AssetType = Annotated[
    str,
    Text(
        128,
        r"[A-Za-z0-9_][A-Za-z0-9_./:-]*",
        "Type of the value, for example geometry_msgs/msg/PoseStamped",
        min_length=1,
    ),
]
MediaType = Annotated[
    str, Text(128, r"[A-Za-z0-9!#$&^_.+-]+/[A-Za-z0-9!#$&^_.+-]+(?:;[ -~]*)?", "Media type (RFC 6838)", min_length=3)
]
AssetValue = Annotated[
    str, Text(MAX_VALUE_CHARACTERS, r"[\s\S]*", "The value: text, or bytes as base64url; the contract never parses it")
]


@dataclass(frozen=True, kw_only=True, slots=True)
class Asset(Record):
    """A value with its type and who owns it."""

    id: AssetId
    type: AssetType
    media_type: MediaType
    value: AssetValue
    owner_msp: MspId
    owner: Annotated[str, Text(128, description="Common name of the owner's certificate")]
    version: Annotated[int, Integer(1, 2**53 - 1, "Counts the writes since its creation")]
    created_ms: TimeMs
    updated_ms: TimeMs


@dataclass(frozen=True, kw_only=True, slots=True)
class AssetChange(Record):
    """One entry of an asset's history."""

    tx_id: Sha256Hex
    t_ms: TimeMs
    deleted: Annotated[bool, Flag()]
    asset: Asset | None = None
