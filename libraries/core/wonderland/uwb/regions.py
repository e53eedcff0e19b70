"""What radio law says about UWB at a landing pad, by region: channels, and what forbids or licenses the use.

A pad is a *fixed* installation, often outdoors, and the drone's node is *airborne*: the two uses that general
permissions leave out nearly everywhere. Nothing here is legal advice; ``read`` says whether the source itself was read
for this, or is known from what cites it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Statement:
    """One sentence of the law, in short words, and where it stands."""

    text: str
    source: str
    read: bool


@dataclass(frozen=True, slots=True)
class Region:
    """``channels``: of high-rate UWB whose band lies within what the region gives to general use."""

    code: str
    name: str
    channels: tuple[int, ...]
    statements: tuple[Statement, ...]


_EU_LIMITS: Final = Statement(
    "6 to 8.5 GHz: -41.3 dBm/MHz mean and 0 dBm in 50 MHz peak; up to 9 GHz with detect-and-avoid only.",
    "Implementing Decision (EU) 2019/785, annex, 1; amended by (EU) 2024/1467: look its changes up",
    read=True,
)
_EU_FIXED: Final = Statement(
    "General use is indoors, or outdoors without a fixed installation, infrastructure or antenna: the anchors of an "
    "outdoor pad are not covered and need an individual licence.",
    "Decision 2007/131/EC, art. 3, taken over by (EU) 2019/785; ECC/DEC/(06)04",
    read=False,
)
_EU_AIR: Final = Statement(
    "Flying models, aircraft and what is installed in them are left out of general use: the drone's node needs a "
    "licence or a permission for trials. The rules for UWB aboard aircraft are about links inside of them.",
    "ECC/DEC/(06)04; ECC/DEC/(12)03 and ETSI EN 302 065-5, scope",
    read=False,
)
REGIONS: Final = (
    Region("EU", "European Union and CEPT", (5, 6, 8, 9), (_EU_LIMITS, _EU_FIXED, _EU_AIR)),
    Region(
        "UK",
        "United Kingdom",
        (5, 6, 8, 9),
        (
            Statement(
                "Exempt from a licence within the limits that the regulations take over from the decision of the EU of "
                "their time; fixed outdoor and airborne use were left out there, too. Ask Ofcom for a licence for "
                "trials and innovation.",
                "The Wireless Telegraphy (Ultra-Wideband Equipment) (Exemption) Regulations, as amended",
                read=False,
            ),
        ),
    ),
    Region(
        "US",
        "United States",
        (5, 6, 8, 9, 10, 12, 13, 14),
        (
            Statement(
                "Operation onboard an aircraft, a ship or a satellite is prohibited: the drone's node needs a waiver "
                "or an experimental licence (47 CFR part 5).",
                "47 CFR 15.521(a)",
                read=True,
            ),
            Statement(
                "Hand-held devices may not use a fixed outdoor antenna or infrastructure; other devices have to be "
                "indoors.",
                "47 CFR 15.519(a)(2), 15.517",
                read=True,
            ),
            Statement(
                "3.1 to 10.6 GHz: -41.3 dBm/MHz mean, 0 dBm in 50 MHz peak.", "47 CFR 15.517, 15.519", read=False
            ),
        ),
    ),
    Region(
        "JP",
        "Japan",
        (9, 10),
        (
            Statement(
                "7.25 to 10.25 GHz; outdoors a part of it. Certified equipment only; whether a fixed outdoor or an "
                "airborne node is permitted was not found out here: ask the Ministry of Internal Affairs and "
                "Communications.",
                "Radio Act, ordinance regulating radio equipment, UWB",
                read=False,
            ),
        ),
    ),
)
BY_CODE: Final = {region.code: region for region in REGIONS}
