"""How long the pad waits in each step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final


@dataclass(frozen=True, slots=True, kw_only=True)
class PadTiming:
    """Limits of one session, in milliseconds; whatever they say, evidence is submitted before the session expires."""

    open_ms: int = 8_000
    """Until the nodes run both sessions."""
    reply_ms: int = 6_000
    """From the poll until the drone has answered with its code."""
    silence_ms: int = 3_000
    """Without a usable round the drone is lost."""
    challenge_spread_ms: int = 400
    """The challenge goes out at a random moment within this time after the reply."""
    echo_ms: int = 4_000
    """From the challenge until its echo."""
    identity_ms: int = 5_000
    """From the reply until the drone has said who it is."""
    confirm_ms: int = 5_000
    """From the last ranges told until the drone has countersigned."""
    fresh_claim_ms: int = 150
    """A look wants a claim no older than this; otherwise it waits for the next one."""
    look_patience_ms: int = 400
    """Longest that a look waits for a claim."""
    witness_ms: int = 6_000
    """From the countersignature until the witness has testified, where the session has one."""
    submit_reserve_ms: int = 5_000
    """Kept free before the session expires, to submit and commit what there is."""
    completion_ms: int = 60_000
    """From the permission until the drone has said how it ended; longer, and the permission lapses."""
    lapse_margin_ms: int = 2_000
    """Added to the session's expiry before a lapse is put on the ledger, whose clock is the transactions'."""
    estimate_every_rounds: int = 5
    """How often a running, unverified estimate is told."""

    def paced(self, pace: float) -> PadTiming:
        """The same where rounds take ``pace`` times as long: what waits for rounds waits so much longer."""
        return self if pace == 1 else replace(self, **{name: round(getattr(self, name) * pace) for name in _OF_ROUNDS})


_OF_ROUNDS: Final = (
    "reply_ms",
    "silence_ms",
    "echo_ms",
    "identity_ms",
    "confirm_ms",
    "fresh_claim_ms",
    "look_patience_ms",
)
