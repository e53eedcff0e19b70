"""Writes ``verdicts.json``: verdicts of known evidence, to the bit. Run by ``make vectors``; look at the diff before you commit it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from kit.proof_world import START_MS, World

from wonderland.proofs.records.calibrations import DroneOffset
from wonderland.proofs.records.sessions import ClockReading, Radio
from wonderland.proofs.testimony import WitnessBrought
from wonderland.proofs.verdict import decide

CASES = {
    "honest": ((3000, 6000, 4000), (3000, 6000, 4000), 20, {}),
    "two metres off": ((3000, 6000, 4000), (5000, 6000, 4000), 20, {}),
    "at the edge": ((3000, 14_000, 4000), (3950, 14_000, 4000), 12, {}),
    "broadcast elsewhere": ((3000, 6000, 4000), (3000, 6000, 4000), 20, {"broadcast": lambda t: (40_000, 6000, 4000)}),
    "broadcast at the edge": ((3000, 6000, 4000), (3000, 6000, 4000), 10, {"broadcast": lambda t: (3880, 6000, 4000)}),
    "rounds missing": (
        (3000, 6000, 4000),
        (3000, 6000, 4000),
        20,
        {"radio": Radio(measured_by="pad", sts="provisioned", attempted_rounds=90)},
    ),
    "anchors in a line": ((3000, 6000, 4000), (3000, 6000, 4000), 20, {}),
    "five anchors, one wrong, and a lie": (
        (3000, 6000, 4000),
        (8000, 6000, 4000),
        20,
        {"bias_mm": (0, 700, 0, 0, 0)},
    ),
    "vague, far off": ((3000, -36_000, 4000), (9000, 6000, 4000), 20, {}),
    "too little known": ((3000, 14_000, 4000), (3000, 14_000, 4000), 20, {}),
    "one anchor wrong": ((3000, 6000, 4000), (3000, 6000, 4000), 20, {"bias_mm": (0, 0, 700, 0)}),
}


WORLDS = {
    "anchors in a line": {"anchors": ((-1500, 0), (-500, 5), (500, -5), (1500, 0))},
    "five anchors, one wrong, and a lie": {
        "anchors": ((1500, 0), (460, 1430), (-1210, 880), (-1210, -880), (460, -1430))
    },
    "vague, far off": {"sigma_mm": 900},
    "too little known": {"bias_sigma_mm": 200},
}


TIMED = {
    "time stamps agree": ((3000, 6000, 4000), (3000, 6000, 4000), 3),
    "ranges lie, time stamps do not": ((3000, 6000, 4000), (6000, 6000, 4000), 2),
    "time stamps cannot tell so far away": ((3000, 14_000, 4000), (3000, 14_000, 4000), 3),
    "one clock is off": ((3000, 6000, 4000), (3000, 6000, 4000), 3),
    "the witness agrees": ((3000, 6000, 4000), (3000, 6000, 4000), 4),
}


def _circle(t_ms: int) -> tuple[float, float, float]:
    """Four metres about a place, by products alone: the same bits on every machine."""
    turn = (t_ms % 4_000) / 4_000.0
    across, along = turn - 0.5, (turn * (1.0 - turn)) * 8.0
    return 3000.0 + 8000.0 * across, 6000.0 + 2000.0 * along, 4000.0


FLOWN = {
    "in flight round a curve": (_circle, _circle, 40),
    "a short leap about the middle": (
        lambda t: (3000, 6000, 4000),
        lambda t: (7000 if 1_300 < t < 1_700 else 3000, 6000, 4000),
        40,
    ),
}


CALIBRATED = {
    "calibrated": (300, DroneOffset(offset_mm=300, sigma_mm=20, measured_ms=0), (300, 500, 1800), (300, 500, 1800)),
    "not calibrated": (300, None, (300, 500, 1800), (300, 500, 1800)),
    "calibrated falsely": (
        0,
        DroneOffset(offset_mm=-500, sigma_mm=20, measured_ms=0),
        (9000, 9000, 4000),
        (9880, 9880, 4000),
    ),
}
"""What its node adds, what it is calibrated to; true and claimed place."""


CLOCKS_MM = {"one clock is off": (0, 0, 400, 0)}


def _vector(name, world, session, evidence, witness=None) -> dict:
    verdict = decide(
        session,
        world.commissioning,
        evidence,
        confirmed=True,
        signature_valid=True,
        authorisation=(),
        now_ms=START_MS + 20_000,
        evidence_sha256="0" * 64,
        witness=witness,
    )
    vector = {
        "name": name,
        "now_ms": START_MS + 20_000,
        "session": session.to_json(),
        "commissioning": world.commissioning.to_json(),
        "evidence": evidence.to_json(),
        "verdict": verdict.to_json(),
    }
    if witness is not None:
        vector["testimony"] = witness.testimony.to_json()
        vector["witness_commissioning"] = witness.commissioning.to_json()
    return vector


def _timed(name) -> dict:
    """The drone's radio makes the ranges fit its claim; the time stamps are where it is."""
    truth, claimed, level = TIMED[name]
    world = World(seed=11)
    world.share_a_clock()
    session = world.session(world.claim(claimed, START_MS), min_assurance=level)
    evidence = replace(
        world.evidence(lambda t: claimed, lambda t: claimed, rounds=40),
        time_stamps=world.stamps(lambda t: truth, frames=40, clock_mm=CLOCKS_MM.get(name, ())),
        clock=(ClockReading(uav_ms=START_MS + 1_030, heard_ms=START_MS + 1_060, asked_ms=START_MS + 1_000),),
    )
    witness = None
    if level == 4:
        other = World(seed=12, anchors=((9500, 1500), (6500, 1500), (6500, -1500), (9500, -1500)))
        other.share_a_clock()
        witness = WitnessBrought(other.testimony(lambda t: truth), other.commissioning)
    return _vector(name, world, session, evidence, witness)


def main() -> None:
    vectors = [_timed(name) for name in TIMED]
    for name, (truth, claimed, rounds, more) in CASES.items():
        world = World(seed=7, **WORLDS.get(name, {}))
        session = world.session(world.claim(claimed, START_MS))
        evidence = world.evidence(lambda t, p=truth: p, lambda t, p=claimed: p, rounds=rounds, **more)
        vectors.append(_vector(name, world, session, evidence))
    for name, (truth, claimed, rounds) in FLOWN.items():
        world = World(seed=9)
        session = world.session(world.claim(claimed(0), START_MS))
        vectors.append(_vector(name, world, session, world.evidence(truth, claimed, rounds=rounds)))
    for name, (delay, calibration, truth, claimed) in CALIBRATED.items():
        world = World(seed=13)
        session = replace(world.session(world.claim(claimed, START_MS)), calibration=calibration)
        evidence = world.evidence(lambda t, p=truth: p, lambda t, p=claimed: p, rounds=60, bias_mm=(delay,) * 4)
        vectors.append(_vector(name, world, session, evidence))
    Path(__file__).with_name("verdicts.json").write_text(
        json.dumps(vectors, separators=(",", ":"), sort_keys=True) + "\n"
    )


if __name__ == "__main__":
    main()
