"""Changes that need two people: one proposes, another one approves, and only then does anything happen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from wonderland.proofs.errors import RecordError
from wonderland.proofs.records.fields import MspId, Name, Note, Sha256Hex, TimeMs, UavId
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.schema import Choice, Record
from wonderland.proofs.records.uavs import PadPattern

OPEN, APPROVED, WITHDRAWN = "open", "approved", "withdrawn"
LIFE_MS: Final = 7 * 86_400_000
"""A proposal that nobody has approved by then is void."""
PolicyAction = Annotated[str, Choice(("*", "land", "takeoff", "dock"))]


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicyChange(Record):
    """The policy that shall hold for a pad (or *) and an action (or *)."""

    pad_id: PadPattern
    action: PolicyAction
    policy: Policy


@dataclass(frozen=True, kw_only=True, slots=True)
class Reinstatement(Record):
    """A suspended drone shall fly again."""

    uav_id: UavId
    reason: Note


@dataclass(frozen=True, kw_only=True, slots=True)
class Signatory(Record):
    """Who signed: the name and the key in the certificate, and the certificate itself."""

    name: Name
    msp_id: MspId
    certificate_sha256: Sha256Hex
    key_sha256: Sha256Hex


@dataclass(frozen=True, kw_only=True, slots=True)
class ProposedChange(Record):
    """A change, who proposed it and what became of it. What it changes stays as it was proposed."""

    change_id: Sha256Hex
    """Transaction id of its proposal."""
    policy: PolicyChange | None = None
    reinstatement: Reinstatement | None = None
    replaces_sha256: Sha256Hex | None = None
    """SHA-256 of the record that it was proposed on; nothing where there was none."""
    proposed_by: Signatory
    proposed_ms: TimeMs
    expires_ms: TimeMs
    note: Note | None = None
    state: Annotated[str, Choice((OPEN, APPROVED, WITHDRAWN))]
    decided_by: Signatory | None = None
    decided_ms: TimeMs | None = None
    decided_note: Note | None = None

    def validate(self, path: str) -> None:
        """It is about one thing."""
        require_one(self.policy, self.reinstatement, path)


def require_one(policy: PolicyChange | None, reinstatement: Reinstatement | None, path: str) -> None:
    """Raises `RecordError` unless one of the two is there."""
    if (policy is None) == (reinstatement is None):
        raise RecordError(path or "policy", "give one of policy and reinstatement")
