"""Many tries of one attack at once: arrays that can be screened together, and the evidence of each single try."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from wonderland.proofs.records.calibrations import DroneOffset
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import (
    NO_RANGE,
    AnchorRanges,
    BroadcastClaim,
    Claim,
    Evidence,
    Party,
    Radio,
    RangeTable,
    Session,
    TimeStamps,
)
from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.testimony import WitnessBrought
from wonderland_research.attack_lab.blinks import commissioned, testimony, time_stamps
from wonderland_research.attack_lab.places import (
    FIRST_ROUND_MS,
    OFFSET_SIGMA_MM,
    POLICY,
    ROUND_MS,
    ROUNDS,
    START_MS,
    Booleans,
    Floats,
    Integers,
    LabPad,
    distances,
    systematic,
)

CLAIM_MS: Final = 200
"""The lab's claims come five times a second; between them a path is a straight line."""
LEAST_ROUNDS: Final = 10
"""Fewer decide nothing under the default policy."""
MAX_RANGE_MM: Final = 655_340
ACCURACY_MM: Final = 100
LIE_BUFFERS: Final = 2.0
LIE_SHARE: Final = 0.25
_PARTY: Final = Party(msp_id="LabMSP", certificate_sha256="0" * 64)


def round_times() -> Integers:
    """Times of the rounds, ms since the request: (ROUNDS,)."""
    return FIRST_ROUND_MS + ROUND_MS * np.arange(ROUNDS, dtype=np.int64)


def claim_times(claim_ms: int = CLAIM_MS) -> Integers:
    """Times of the claims, ms since the request; they reach beyond the last round."""
    return claim_ms * np.arange(2 + (FIRST_ROUND_MS + ROUND_MS * ROUNDS) // claim_ms, dtype=np.int64)


@dataclass
class Batch:
    """B tries of one attack at one pad and one level."""

    pad: LabPad
    claims: Integers
    """What the drone claims at ``claim_times``: (B, K, 3) mm."""
    range_mm: Integers
    """What the pad writes down: (B, ROUNDS, A), −1 for nothing."""
    off_mm: Floats
    """How far the drone truly is from its claim in each round, horizontally: (B, ROUNDS)."""
    assurance: int = 2
    policy: Policy = POLICY
    accuracy_mm: int = ACCURACY_MM
    height_accuracy_mm: int = 2 * ACCURACY_MM
    broadcast: Integers | None = None
    """What it tells the public at ``claim_times``, where that differs: (B, K, 3) mm."""
    broadcast_accuracy_mm: int | None = None
    """How good it says that is, 95 %."""
    rightful: bool = False
    """A permission is no success of the attacker: the drone is where it claims."""
    heard_mm: Floats | None = None
    """How far the drone's own frames seem to have come, from level 3 on: (B, ROUNDS, A) mm."""
    witness: LabPad | None = None
    witness_heard_mm: Floats | None = None
    """The same at the second pad, at level 4."""
    steady: bool = False
    """Nothing changes from round to round but the noise, so that what contradicts itself goes on doing so."""
    attempts: int | None = 1
    """Rounds that the pad attempted for each one that came about; None where it did not count them."""
    claim_ms: int = CLAIM_MS
    """Time from one claim to the next."""
    truth_mm: Floats | None = None
    """Where the drone was in each round, (B, ROUNDS, 3), where an attack's success is about single moments."""
    won_if_refuted: bool = False
    """The drone is honest: to refute it is what must not happen."""
    vertical: bool = False
    """It is about the height: ``off_mm`` is vertical, and so is what ``truth_mm`` is held against."""
    won_mm: float | None = None
    """From this distance on a permission is the attacker's success; the policy's buffer where nothing else is said."""
    offset_mm: Integers | None = None
    """What each try's drone is calibrated to, truly or not: (B,); None: nobody calibrated it."""
    t_ms: Integers = field(default_factory=round_times)
    commissioning: Commissioning = field(init=False)

    def __post_init__(self) -> None:
        self.commissioning = commissioned(self.pad) if self.heard_mm is not None else self.pad.commissioning

    def __len__(self) -> int:
        return len(self.range_mm)

    @property
    def may_be_screened(self) -> bool:
        """Whether arrays tell enough: a second claim that is judged apart is left to the decision itself.

        So are single moments, heights, a bias that a moving drone averages out, and calibrated drones.
        """
        plain = self.broadcast is None and self.heard_mm is None and self.truth_mm is None and not self.vertical
        return plain and self.pad.bias_length is None and self.offset_mm is None

    def session(self, index: int) -> Session:
        """The request of one try."""
        return Session(
            session_id="0" * 64,
            state="requested",
            pad_id="lab",
            uav_id="attacker",
            action="land",
            claim=self._claim(index, 0),
            prekey_id="k",
            pad_key="A" * 87,
            uav_key="A" * 87,
            pad=_PARTY,
            uav=_PARTY,
            commissioning_sha256="0" * 64,
            contract_version="1.0",
            transcript_sha256="0" * 64,
            policy=self.policy,
            requested_ms=START_MS,
            expires_ms=START_MS + 60_000,
            calibration=self._calibration(index),
        )

    def evidence(self, index: int, rounds: int) -> Evidence:
        """What the pad would bring before the contract after so many rounds."""
        table = self.range_mm[index, :rounds]
        anchors = self.commissioning.anchors
        until = int(self.t_ms[rounds - 1]) + self.claim_ms
        told = [number for number, t_ms in enumerate(claim_times(self.claim_ms)) if 0 < t_ms <= until]
        heard: tuple[BroadcastClaim, ...] = ()
        if self.broadcast is not None:
            said = self.broadcast
            heard = tuple(
                BroadcastClaim(
                    lat_e7=int(said[index, number, 1]),
                    lon_e7=int(said[index, number, 0]),
                    height_mm=int(said[index, number, 2]),
                    accuracy_mm=self.broadcast_accuracy_mm,
                    t_ms=START_MS + number * self.claim_ms,
                )
                for number in told
            )
        return Evidence(
            ranges=RangeTable(
                t_ms=tuple((START_MS + self.t_ms[:rounds]).tolist()),
                anchors=tuple(
                    AnchorRanges(anchor_id=anchor.anchor_id, range_mm=tuple(table[:, column].tolist()))
                    for column, anchor in enumerate(anchors)
                ),
            ),
            claims=tuple(self._claim(index, number) for number in told),
            broadcast=heard,
            matched="both",
            radio=Radio(
                measured_by="uav" if self.assurance == 0 else "pad",
                sts="provisioned" if self.assurance >= 2 else "static",
                attempted_rounds=None if self.assurance == 0 or self.attempts is None else rounds * self.attempts,
            ),
            steps=(),
            time_stamps=self._time_stamps(index, rounds),
        )

    def witnessed(self, index: int, rounds: int) -> WitnessBrought | None:
        """What the second pad brought of one try by then."""
        if self.witness is None or self.witness_heard_mm is None:
            return None
        survey = commissioned(self.witness)
        return WitnessBrought(testimony(survey, self.witness_heard_mm[index, :rounds]), survey)

    def _calibration(self, index: int) -> DroneOffset | None:
        if self.offset_mm is None:
            return None
        return DroneOffset(offset_mm=int(self.offset_mm[index]), sigma_mm=OFFSET_SIGMA_MM, measured_ms=0)

    def _time_stamps(self, index: int, rounds: int) -> TimeStamps | None:
        if self.heard_mm is None:
            return None
        return time_stamps(self.commissioning, self.heard_mm[index, :rounds], "challenge")

    def _claim(self, index: int, number: int) -> Claim:
        east, north, up = (int(value) for value in self.claims[index, number])
        return Claim(
            lat_e7=north,
            lon_e7=east,
            height_mm=up,
            accuracy_mm=self.accuracy_mm,
            height_accuracy_mm=self.height_accuracy_mm,
            t_ms=START_MS + number * self.claim_ms,
        )


def standing(place: Floats) -> Integers:
    """Claims of drones that stay at a place: (B, 3) → (B, K, 3)."""
    whole = np.rint(place).astype(np.int64)
    return np.repeat(whole[:, None, :], len(claim_times()), axis=1)


def moving(place: Floats, velocity: Floats) -> Integers:
    """Claims along straight lines: ``place`` at the request, ``velocity`` in mm/ms."""
    times = claim_times()[None, :, None]
    return np.rint(place[:, None, :] + velocity[:, None, :] * times).astype(np.int64)


def path_at_rounds(claims: Integers, claim_ms: int = CLAIM_MS) -> Floats:
    """Claimed places at the times of the rounds: (B, ROUNDS, 3)."""
    times = round_times()
    before = times // claim_ms
    share = ((times % claim_ms) / claim_ms)[None, :, None]
    return np.asarray(claims[:, before] + (claims[:, before + 1] - claims[:, before]) * share, dtype=np.float64)


def measured(
    rng: np.random.Generator,
    pad: LabPad,
    truth: Floats,
    *,
    extra: Floats | None = None,
    anchors: Floats | None = None,
    noise: float | None = None,
    bias: Floats | None = None,
) -> Integers:
    """Whole centimetres that the pad's anchors measure, in mm: (B, ROUNDS, A).

    ``truth``: (B, 1 or ROUNDS, 3). ``extra``: an attacker's errors in mm, broadcast to the result. ``anchors``: where
    they truly stand, (A, 3) or (B, 1, A, 3), if not where the survey says. ``bias``: the commissioning's errors, where
    they change through the session.
    """
    places = pad.anchors if anchors is None else anchors
    away = (
        distances(truth, places)
        if places.ndim == 2
        else np.asarray(np.linalg.norm(truth[:, :, None, :] - places, axis=-1), dtype=np.float64)
    )
    count, per_round = len(truth), len(pad.anchors)
    error = rng.normal(0.0, pad.range_sigma if noise is None else noise, (count, ROUNDS, per_round))
    total = away + (systematic(rng, count, per_round) if bias is None else bias) + error
    if extra is not None:
        total = total + extra
    return rounded_cm(total)


def rounded_cm(range_mm: Floats) -> Integers:
    """As UCI reports: whole centimetres, never below zero; NaN is nothing."""
    lost = ~np.isfinite(range_mm)
    whole = np.clip(np.rint(np.where(lost, 0.0, range_mm) / 10.0) * 10.0, 0.0, MAX_RANGE_MM).astype(np.int64)
    return np.where(lost, NO_RANGE, whole)


def vertically_off(truth: Floats, claims: Integers, claim_ms: int = CLAIM_MS) -> Floats:
    """The same in height, whichever way: (B, ROUNDS)."""
    return np.asarray(np.abs(path_at_rounds(claims, claim_ms)[..., 2] - truth[..., 2]))


def off(truth: Floats, claims: Integers, claim_ms: int = CLAIM_MS) -> Floats:
    """Horizontal distance (mm) between truth (B, 1 or ROUNDS, 3) and claim in each round: (B, ROUNDS)."""
    difference = path_at_rounds(claims, claim_ms)[..., :2] - truth[..., :2]
    return np.asarray(np.linalg.norm(difference, axis=-1), dtype=np.float64)


def wrongful(batch: Batch) -> Booleans:
    """Where a permission would be the attacker's success: (B, ROUNDS)."""
    if batch.rightful:
        return np.zeros_like(batch.off_mm, dtype=bool)
    least = float(batch.policy.buffer_mm) if batch.won_mm is None else batch.won_mm
    return np.asarray(batch.off_mm >= least)


def won_at_moments(batch: Batch, row: int, rounds: int, verdict: Verdict) -> tuple[bool, int]:
    """Whether a permission is wrong for single moments, and how far off (mm) the certified place is.

    It is where that place is more than a buffer from the drone at its moment, or where a quarter of the claims during
    the rounds are two buffers off or more.
    """
    if batch.truth_mm is None or verdict.estimate is None or verdict.estimate_ms is None:
        raise ValueError("a permission without a place, or an attack without the truth")
    truth, times = batch.truth_mm[row], batch.t_ms
    axes = (2,) if batch.vertical else (0, 1)
    at_ms = verdict.estimate_ms - START_MS
    certified = (verdict.estimate.east_mm, verdict.estimate.north_mm, verdict.estimate.up_mm)
    away = float(np.linalg.norm([certified[axis] - np.interp(at_ms, times, truth[:, axis]) for axis in axes]))
    told = claim_times(batch.claim_ms)
    during = (told >= times[0]) & (told <= times[rounds - 1])
    there = np.stack([np.interp(told[during], times, truth[:, axis]) for axis in axes], axis=1)
    lies = np.linalg.norm(batch.claims[row][during][:, axes] - there, axis=1)
    buffer_mm = float(batch.policy.height_buffer_mm if batch.vertical else batch.policy.buffer_mm)
    return away > buffer_mm or float(np.mean(lies >= LIE_BUFFERS * buffer_mm)) >= LIE_SHARE, round(away)
