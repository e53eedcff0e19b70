"""The kinds of alerts: which there are, how grave each is, and what it says in plain words (for e-mail and machines).

The console says the same in its user's language and units, from the alert's kind and facts.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from backend.alerts import finnish
from backend.languages import Language

Severity = Literal["critical", "warning", "notice"]


@dataclass(frozen=True)
class Kind:
    """One kind of alert. `text` is filled from the alert's facts."""

    severity: Severity
    text: str


KINDS: Final[Mapping[str, Kind]] = {
    "refuted": Kind("critical", "{uav_id} is not where it says: measured {distance} from its claim at {pad_id}."),
    "broadcast_contradicts": Kind(
        "critical",
        "{uav_id} signed for a broadcast of another place than it told {pad_id}: measured {distance} from there.",
    ),
    "broadcast_unattributed": Kind(
        "warning",
        "Somebody broadcasts under {uav_id} {distance} from where {pad_id} measured it: an impostor, or its own lie.",
    ),
    "stamps_contradict": Kind(
        "critical",
        "{uav_id} bends its clock at {pad_id}: time stamps that need none put it {distance} from its claim.",
    ),
    "leaving": Kind(
        "critical", "{uav_id} was leaving the place that it claims at {pad_id} while the pad ranged it: refuted."
    ),
    "permission_unmatched": Kind(
        "critical", "{uav_id} was given permission at {pad_id}, and since then no broadcast of it was heard there."
    ),
    "ledger_halted": Kind("critical", "The mirror of the ledger has halted: {why}."),
    "unauthorised": Kind("warning", "{uav_id} asked for {action} at {pad_id} without being authorised."),
    "zone_closed": Kind("warning", "{uav_id} asked for {action} at {pad_id}, which a zone closes: {why}."),
    "closures_ending": Kind(
        "warning", "The closures of {pad_id} by zones are published until {until} only; after that it permits nothing."
    ),
    "closures_differ": Kind(
        "warning",
        "What the ledger says of zones that close {pad_id} is not what the imported zones say: {why}. Publish anew.",
    ),
    "identity_odd": Kind("warning", "{pad_id} hears something odd under the name {uav_id}: {what}."),
    "broadcast_odd": Kind("notice", "{pad_id} hears something odd of {uav_id}: {what}."),
    "broadcasts_flooded": Kind(
        "warning",
        "{pad_id} hears odd broadcasts under {drones} names at once; only the first have alerts of their own.",
    ),
    "pad_silent": Kind("warning", "Pad {pad_id} has not reported since {since}."),
    "pad_drifting": Kind("warning", "Pad {pad_id} no longer measures as it was commissioned: {why}."),
    "certificate_expiring": Kind("warning", "The certificate of {who} expires on {until}."),
    "ledger_away": Kind("warning", "The ledger cannot be reached: {why}."),
}


@dataclass(frozen=True)
class Alert:
    """An alert as it arises. `source` tells two of one kind apart; the same source never makes a second alert."""

    kind: str
    source: str
    t_ms: int
    pad_id: str | None = None
    uav_id: str | None = None
    session_id: str | None = None
    tx_id: str | None = None
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def alert_id(self) -> str:
        """32 hexadecimal digits, the same on every replica."""
        return hashlib.sha256(f"{self.kind}\0{self.source}".encode()).hexdigest()[:32]

    @property
    def severity(self) -> Severity:
        """How grave it is."""
        return KINDS[self.kind].severity


class _Known(dict[str, Any]):
    def __missing__(self, key: str) -> str:
        return "unknown"


def plain_text(
    kind: str, pad_id: str | None, uav_id: str | None, facts: Mapping[str, Any], language: Language = "en"
) -> str:
    """The alert in one sentence. What it does not know it calls unknown."""
    if kind not in KINDS:
        return kind
    known = {name: value for name, value in {"pad_id": pad_id, "uav_id": uav_id}.items() if value is not None}
    shown = _Known({**facts, **known})
    if isinstance(facts.get("error_mm"), int):
        shown["distance"] = f"{facts['error_mm'] / 1000:.1f} m"
    return finnish.text(kind, shown) if language == "fi" else KINDS[kind].text.format_map(shown)
