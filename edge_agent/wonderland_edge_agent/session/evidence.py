"""What a session gathers for the contract, column by column, within the bounds of the records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from wonderland.proofs.encoding import to_base64url
from wonderland.proofs.records.fields import MAX_TIME_MS
from wonderland.proofs.records.sessions import (
    MAX_CLAIMS,
    MAX_ROUNDS,
    AnchorRanges,
    BroadcastClaim,
    Claim,
    ClockReading,
    Evidence,
    Radio,
    RangeTable,
    StepTime,
    TimeStamps,
)
from wonderland.telemetry import StepName
from wonderland.uwb.link.proof_payloads import ClaimBatch
from wonderland_edge_agent.session.gather import Round

MAX_ANSWERS: Final = 8


class GatheredEvidence:
    """Rounds, claims and steps of one session. ``freeze`` ends the table of ranges that the drone countersigns."""

    def __init__(self, anchor_ids: Sequence[str]) -> None:
        self.anchor_ids = tuple(anchor_ids)
        self._t_ms: list[int] = []
        self._columns: list[list[int]] = [[] for _ in self.anchor_ids]
        self._nlos: list[list[int]] = [[] for _ in self.anchor_ids]
        self._claims: list[Claim] = []
        self.attested: tuple[str, ...] = ()
        """Digests of the Remote ID positions that the drone says it broadcast; its signature covers them."""
        self._steps: dict[StepName, int] = {}
        self._answers: list[ClockReading] = []
        self._said: ClockReading | None = None
        self.frozen = False

    @property
    def rounds(self) -> int:
        """Rounds gathered."""
        return len(self._t_ms)

    @property
    def last_ms(self) -> int:
        """When the last round was; 0 before the first."""
        return self._t_ms[-1] if self._t_ms else 0

    @property
    def claims(self) -> tuple[Claim, ...]:
        """Claims that the drone sent, in its order."""
        return tuple(self._claims)

    @property
    def steps(self) -> dict[StepName, int]:
        """Time of each step that was reached, ms."""
        return dict(self._steps)

    def add_round(self, gathered: Round) -> bool:
        """Append a round; False once frozen or full."""
        if self.frozen or len(self._t_ms) >= MAX_ROUNDS:
            return False
        position = len(self._t_ms)
        self._t_ms.append(gathered.t_ms)
        for column, nlos, range_mm, obstructed in zip(
            self._columns, self._nlos, gathered.range_mm, gathered.nlos, strict=True
        ):
            column.append(range_mm)
            if obstructed:
                nlos.append(position)
        return True

    def add_claims(self, batch: ClaimBatch) -> bool:
        """Append claims; False where their numbers do not follow on those before: nothing may be missing or changed."""
        if batch.first_index != len(self._claims) or len(self._claims) + len(batch.claims) > MAX_CLAIMS:
            return False
        self._claims.extend(batch.claims)
        return True

    def attest(self, digests: Sequence[bytes]) -> bool:
        """Take the drone's list of its own broadcasts; False for a second one."""
        if self.attested:
            return False
        self.attested = tuple(to_base64url(digest) for digest in digests)
        return True

    @property
    def clock(self) -> tuple[ClockReading, ...]:
        """Readings of the drone's clock: its answers, and the one claim that bounds it best."""
        return (*self._answers, *(() if self._said is None else (self._said,)))

    def read_clock(self, uav_ms: int, heard_ms: int, asked_ms: int | None = None) -> None:
        """The drone said ``uav_ms`` by its clock; heard at ``heard_ms``, asked for at ``asked_ms`` by the pad's."""
        if not (0 <= uav_ms <= MAX_TIME_MS and 0 <= heard_ms <= MAX_TIME_MS):
            return
        reading = ClockReading(uav_ms=uav_ms, heard_ms=heard_ms, asked_ms=asked_ms)
        if asked_ms is not None:
            if len(self._answers) < MAX_ANSWERS:
                self._answers.append(reading)
        elif self._said is None or uav_ms - heard_ms > self._said.uav_ms - self._said.heard_ms:
            self._said = reading

    def reach(self, step: StepName, t_ms: int) -> bool:
        """Note the time of a step, the first time only; False if it was reached before."""
        if step in self._steps:
            return False
        self._steps[step] = t_ms
        return True

    def table(self, start: int = 0, stop: int | None = None) -> RangeTable:
        """The rounds from ``start`` to ``stop``."""
        rows = slice(start, len(self._t_ms) if stop is None else stop)
        indices = range(len(self._t_ms))[rows]
        return RangeTable(
            t_ms=tuple(self._t_ms[rows]),
            anchors=tuple(
                AnchorRanges(
                    anchor_id=anchor_id,
                    range_mm=tuple(column[rows]),
                    nlos=tuple(position - indices.start for position in nlos if position in indices),
                )
                for anchor_id, column, nlos in zip(self.anchor_ids, self._columns, self._nlos, strict=True)
            ),
        )

    def latest(self) -> dict[str, int]:
        """The last round's ranges by anchor, mm; anchors that measured nothing are left out."""
        return {
            anchor_id: column[-1]
            for anchor_id, column in zip(self.anchor_ids, self._columns, strict=True)
            if column and column[-1] > 0
        }

    def evidence(
        self,
        *,
        matched: bool,
        broadcast: Sequence[BroadcastClaim],
        radio: Radio,
        uav_signature: str | None = None,
        failure: str | None = None,
        time_stamps: TimeStamps | None = None,
        drift_sigma_mm: int | None = None,
    ) -> Evidence:
        """The record that SubmitProof takes."""
        return Evidence(
            ranges=self.table(),
            claims=self.claims,
            broadcast=tuple(broadcast),
            matched="both" if matched else "none",
            radio=radio,
            steps=tuple(StepTime(step=step, t_ms=t_ms) for step, t_ms in self._steps.items()),
            uav_signature=uav_signature,
            failure=failure,
            time_stamps=time_stamps,
            clock=self.clock,
            attested=self.attested,
            drift_sigma_mm=drift_sigma_mm,
        )
