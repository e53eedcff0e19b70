"""The kinds of alerts: which there are, how grave each is, and what it says, for e-mail and machines."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal

from wonderland import messages
from wonderland.messages import Language

Severity = Literal["critical", "warning", "notice"]


SEVERITIES: Final[Mapping[str, Severity]] = {
    "refuted": "critical",
    "broadcast_contradicts": "critical",
    "broadcast_unattributed": "warning",
    "stamps_contradict": "critical",
    "leaving": "critical",
    "permission_unmatched": "critical",
    "landed_unpermitted": "critical",
    "ledger_halted": "critical",
    "rows_differ": "critical",
    "unauthorised": "warning",
    "zone_closed": "warning",
    "closures_ending": "warning",
    "closures_differ": "warning",
    "identity_odd": "warning",
    "broadcast_odd": "notice",
    "broadcasts_flooded": "warning",
    "pad_silent": "warning",
    "pad_drifting": "warning",
    "certificate_expiring": "warning",
    "ledger_away": "warning",
    "ledger_alone": "warning",
}
"""Every kind of alert. Its words are in the catalogues of messages (`alerts`, `alert-titles`), of every language."""
if TYPE_CHECKING:
    KindName = str
else:
    KindName = Literal[tuple(SEVERITIES)]


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
        return SEVERITIES[self.kind]


def plain_text(
    kind: str, pad_id: str | None, uav_id: str | None, facts: Mapping[str, Any], language: Language = "en"
) -> str:
    """The alert in one sentence."""
    about = {name: value for name, value in {"pad_id": pad_id, "uav_id": uav_id}.items() if value is not None}
    known = {**facts, **about}
    if "finding" in known:
        known["what"] = messages.text("findings", known["finding"], known, language)
    return messages.text("alerts", kind, known, language).replace("<b>", "").replace("</b>", "")
