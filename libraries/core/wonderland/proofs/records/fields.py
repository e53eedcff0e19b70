"""Fields that several records share: identifiers, times, positions."""

from __future__ import annotations

from typing import Annotated, Final

from wonderland.proofs.records.schema import Binary, Choice, Integer, Text

ID_PATTERN: Final = r"[A-Za-z0-9][A-Za-z0-9._:-]*"
MAX_TIME_MS: Final = 253_402_300_799_999
"""The end of the year 9999."""

PadId = Annotated[str, Text(64, ID_PATTERN, "Identifier of the landing pad", min_length=1)]
UavId = Annotated[
    str, Text(40, ID_PATTERN, "Serial number of the drone, as it broadcasts it (ANSI/CTA-2063-A)", min_length=1)
]
OperatorId = Annotated[str, Text(64, ID_PATTERN, "Identifier of the operator", min_length=1)]
AnchorId = Annotated[str, Text(16, ID_PATTERN, "Name of the anchor on its pad", min_length=1)]
SessionId = Annotated[str, Text(64, r"[0-9a-f]{64}", "Transaction id of the RequestProof that opened the session")]
PrekeyId = Annotated[str, Text(64, ID_PATTERN, "Identifier of the pad's one-time key", min_length=1)]
Sha256Hex = Annotated[str, Text(64, r"[0-9a-f]{64}", "SHA-256, lower-case hexadecimal")]
Name = Annotated[str, Text(120, description="Name for people", min_length=1)]
Note = Annotated[str, Text(500, description="Text for people")]
MspId = Annotated[str, Text(64, r"[A-Za-z0-9.-]+", "Organisation (membership service provider)", min_length=1)]
PublicKey = Annotated[str, Binary(65, 65, "P-256 public key: 0x04, x, y (SEC 1, uncompressed)")]

TimeMs = Annotated[int, Integer(0, MAX_TIME_MS, "Milliseconds since the Unix epoch")]
LatE7 = Annotated[int, Integer(-900_000_000, 900_000_000, "WGS-84 latitude in degrees × 10⁷")]
LonE7 = Annotated[int, Integer(-1_800_000_000, 1_800_000_000, "WGS-84 longitude in degrees × 10⁷")]
HeightMm = Annotated[int, Integer(-1_000_000, 50_000_000, "Height above the WGS-84 ellipsoid")]
LocalMm = Annotated[int, Integer(-100_000_000, 100_000_000, "Millimetres in the pad's frame")]
Ppm = Annotated[int, Integer(0, 1_000_000, "Parts per million")]
Action = Annotated[str, Choice(("land", "takeoff", "dock"), "What the drone asks to do")]
ACTIONS: Final = ("land", "takeoff", "dock")
