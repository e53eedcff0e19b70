"""What the nodes of a pad hear of a drone's own frames, on the pad's clock: the evidence of assurance 3 and 4."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from wonderland.proofs.differences import MM_PER_TICK
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.sessions import AnchorTicks, Radio, Testimony, TimeStamps
from wonderland_research.attack_lab.places import (
    FIRST_ROUND_MS,
    ROUND_MS,
    ROUNDS,
    START_MS,
    SURVEY_SIGMA_MM,
    Floats,
    LabPad,
    distances,
)

STAMP_SIGMA_MM: Final = 30
CLOCK_SIGMA_MM: Final = 5
"""Nodes on one clock, synchronised by cable to 17 ps."""


def commissioned(pad: LabPad) -> Commissioning:
    """The pad with a common clock."""
    plain = pad.commissioning
    return replace(
        plain,
        timestamp_sigma_mm=STAMP_SIGMA_MM,
        anchors=tuple(replace(anchor, clock_sigma_mm=CLOCK_SIGMA_MM) for anchor in plain.anchors),
    )


def heard(
    rng: np.random.Generator,
    pad: LabPad,
    truth: Floats,
    *,
    extra: Floats | None = None,
    anchors: Floats | None = None,
) -> Floats:
    """How far each frame seems to have come to each anchor, mm: (B, ROUNDS, A); a frame each round.

    ``truth``: (B, 1 or ROUNDS, 3). ``extra``: an attacker's delay for each anchor (B, 1, A); a drone with one antenna
    has none, as the same frame leaves for all of them at once. ``anchors``: where they truly stand, if elsewhere.
    """
    places = pad.anchors if anchors is None else anchors
    away = (
        distances(truth, places)
        if places.ndim == 2
        else np.asarray(np.linalg.norm(truth[:, :, None, :] - places, axis=-1), dtype=np.float64)
    )
    count, per_frame = len(truth), len(pad.anchors)
    fixed = rng.normal(0.0, np.hypot(CLOCK_SIGMA_MM, SURVEY_SIGMA_MM), (count, 1, per_frame))
    white = rng.normal(0.0, STAMP_SIGMA_MM, (count, ROUNDS, per_frame))
    total = away + fixed + white
    return np.asarray(total if extra is None else total + extra, dtype=np.float64)


def time_stamps(pad: Commissioning, heard_mm: Floats, bound_by: str) -> TimeStamps:
    """The record of the frames of one try, (F, A): ticks after the first anchor that heard each."""
    ticks = np.rint((heard_mm - heard_mm.min(axis=1, keepdims=True)) / MM_PER_TICK).astype(np.int64)
    return TimeStamps(
        start_ms=START_MS + FIRST_ROUND_MS,
        gap_ms=(0,) + (ROUND_MS,) * (len(ticks) - 1),
        anchors=tuple(
            AnchorTicks(anchor_id=anchor.anchor_id, ticks=tuple(ticks[:, column].tolist()))
            for column, anchor in enumerate(pad.anchors)
        ),
        bound_by=bound_by,
    )


def testimony(pad: Commissioning, heard_mm: Floats) -> Testimony:
    """What a second pad brings of one try."""
    return Testimony(
        session_id="0" * 64,
        pad_id="witness",
        msp_id="WitnessMSP",
        certificate_sha256="0" * 64,
        commissioning_sha256="0" * 64,
        radio=Radio(measured_by="pad", sts="provisioned"),
        time_stamps=time_stamps(pad, heard_mm, "key"),
        testified_ms=START_MS + 10_000,
    )
