"""How long the drone waits in each step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final


@dataclass(frozen=True, slots=True, kw_only=True)
class UavTiming:
    """Limits of one session, in milliseconds; nothing is waited for beyond the session's expiry."""

    open_ms: int = 8_000
    """Until the node runs both sessions."""
    ranging_ms: int = 15_000
    """From the drone's reply until the pad has told all ranges: the most rounds, and room for repeats."""
    pad_silence_ms: int = 6_000
    """Without a word from the pad while ranging it is lost."""
    claim_interval_ms: int = 100
    """Between two claims; a look of the pad wants a fresh one."""
    slow_claim_interval_ms: int = 500
    """The same once most of the claims that a session may hold are spent."""
    fast_claims: int = 100
    """How many claims go at the fast interval."""
    verdict_grace_ms: int = 5_000
    """Beyond the session's expiry a verdict may still be on its way through a block."""
    act_ms: int = 300_000
    """Longest that the permitted action may take before it is recorded as aborted."""

    def paced(self, pace: float) -> UavTiming:
        """The same where rounds take ``pace`` times as long: what waits for rounds waits so much longer."""
        return self if pace == 1 else replace(self, **{name: round(getattr(self, name) * pace) for name in _OF_ROUNDS})


_OF_ROUNDS: Final = ("ranging_ms", "pad_silence_ms", "claim_interval_ms", "slow_claim_interval_ms")
