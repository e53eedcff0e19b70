"""Assurance 3 by numbers: how often time stamps alone are wrong, where they suffice, what they cost.

The mean time stamps are drawn from their own distribution (σ²/N white, clock and survey once a try) and judged by the
decision's own function after every look of a pad.
"""

from __future__ import annotations

import random
import time
from dataclasses import replace
from math import cos, pi, radians, sin

import pytest
from bench.bench_tools import show
from kit.proof_world import SQUARE, START_MS, World

from wonderland.proofs.differences import Stamped, frames_needed, judge_times
from wonderland.proofs.hyperbolic import Heard, TimeFix
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.reduction import distance
from wonderland.proofs.stopping import LOOKS
from wonderland.proofs.testimony import halved
from wonderland.proofs.verdict import decide
from wonderland_research.reproduction.sampling import Share

pytestmark = [pytest.mark.bench, pytest.mark.timeout(1800)]
TRIES = 3_000
STAMP_MM, CLOCK_MM, SURVEY_MM = 30.0, 5.0, 3.0
UP = 3_000.0
# Beside the raised anchor, where four of them leave no second place.
PLACES = {"4 m": (2_400.0, -3_200.0), "7 m": (4_200.0, -5_600.0), "10 m": (6_000.0, -8_000.0)}


def looks(rng, truth, claimed, corners=SQUARE, most=LOOKS[-1]):
    """What the differences say at each look; the clocks and the survey are off in the same way at all of them."""
    floor = [rng.gauss(0, CLOCK_MM) + rng.gauss(0, SURVEY_MM) for _ in corners]
    sums = [0.0] * len(corners)
    frames = 0
    for look in LOOKS:
        if look > most:
            return
        for index in range(len(corners)):
            sums[index] += rng.gauss(0, STAMP_MM * (look - frames) ** 0.5)
        frames = look
        heard = []
        for index, (east, north) in enumerate(corners):
            up = 1200.0 if index == 0 else 200.0
            away = distance(truth[0] - east, truth[1] - north, UP - up)
            white, still = STAMP_MM**2 / frames, CLOCK_MM**2 + SURVEY_MM**2
            length = away + floor[index] + sums[index] / frames
            heard.append(Heard(index, float(east), float(north), up, length, white, still))
        means = Stamped(TimeFix(heard, UP, 50.0), *claimed, frames, float(frames), 0, 0.0, 0.0)
        yield judge_times(means, halved(Policy()), None, 0.0).finding


def count(truth_of, claimed, seed, tries=TRIES):
    """(ever inside, ever outside) of tries, the drone at ``truth_of(rng)``."""
    rng = random.Random(seed)
    inside = outside = 0
    for _ in range(tries):
        for finding in looks(rng, truth_of(rng), claimed):
            if finding in {"inside", "outside"}:
                inside += finding == "inside"
                outside += finding == "outside"
                break
    return inside, outside


def show_share(hits, tries):
    low, high = Share(hits, tries).interval
    return f"{100 * hits / tries:.2f} % ({100 * low:.2f}–{100 * high:.2f})"


def test_error_rates_of_time_stamps_alone(keep):
    rows = []
    for name, claimed in PLACES.items():
        away = distance(*claimed, 0.0)
        along = (claimed[0] / away, claimed[1] / away)
        edge = {
            "radial": (claimed[0] + 1000 * along[0], claimed[1] + 1000 * along[1]),
            "lateral": (claimed[0] - 1000 * along[1], claimed[1] + 1000 * along[0]),
        }
        for direction, place in edge.items():
            inside, outside = count(lambda _, place=place: place, claimed, 7)
            rows.append((name, f"on the edge, {direction}", show_share(inside, TRIES), show_share(outside, TRIES)))
            keep(place=name, case=f"edge {direction}", inside=inside, outside=outside, tries=TRIES)
            assert inside <= 0.015 * TRIES
            assert outside <= 0.015 * TRIES
        inside, outside = count(lambda _, claimed=claimed: claimed, claimed, 8, TRIES // 2)
        rows.append((name, "at its claim", show_share(inside, TRIES // 2), show_share(outside, TRIES // 2)))
        keep(place=name, case="honest", inside=inside, outside=outside, tries=TRIES // 2)
        assert outside <= 0.001 * TRIES
        far = (claimed[0] - 3000 * along[0], claimed[1] - 3000 * along[1])
        inside, outside = count(lambda _, far=far: far, claimed, 9, TRIES // 2)
        rows.append(
            (name, "3 m nearer on the bearing", show_share(inside, TRIES // 2), show_share(outside, TRIES // 2))
        )
        keep(place=name, case="3 m radial lie", inside=inside, outside=outside, tries=TRIES // 2)
        assert inside == 0
    show(
        "Time stamps alone (30 mm, clocks 5 mm, a pad of 3 m), looked at up to 160 frames: ever proved inside, outside",
        ("distance", "the drone is", "inside", "outside"),
        rows,
    )


def around(count, side):
    """So many anchors on the circle about a square of this side."""
    radius, turns = side / 2**0.5, (2 * pi * index / count + 0.4 for index in range(count))
    return tuple((round(radius * cos(turn)), round(radius * sin(turn))) for turn in turns)


def reach_m(corners, clock_mm, bearings):
    """Out to how many metres a buffer of 1 m can be proved in all these directions within 160 frames."""
    world = World(1, anchors=corners)
    world.share_a_clock(clock_sigma_mm=clock_mm)
    for metres in range(1, 60):
        for bearing in bearings:
            place = (metres * 1000 * cos(radians(bearing)), metres * 1000 * sin(radians(bearing)), UP)
            if not 0 < frames_needed(world.commissioning, Policy(), *place) <= LOOKS[-1]:
                return metres - 1
    return metres


# The raised anchor is the one to the north-east: quarters beside it are to the south-east and north-west.
BESIDE, EVERYWHERE = (-65, -45, -25, 115, 135, 155), tuple(range(0, 360, 30))


def test_where_time_stamps_suffice(keep):
    rows = []
    for side in (2000, 3000, 6000, 8000):
        half = side // 2
        square = ((half, half), (-half, half), (-half, -half), (half, -half))
        for name, corners, bearings in (
            ("four, beside the raised one", square, BESIDE),
            ("six around it, everywhere", around(6, side), EVERYWHERE),
        ):
            reaches = [reach_m(corners, clock_mm, bearings) for clock_mm in (2, 5, 10)]
            rows.append((f"{side / 1000:g} m", name, *(f"{reach} m" if reach else "-" for reach in reaches)))
            keep(side_mm=side, anchors=name, reach_m=reaches)
            assert reaches == sorted(reaches, reverse=True)
    show(
        "How far a buffer of 1 m can be proved at assurance 3 (160 frames), whatever the height",
        ("square", "anchors", "clocks 2 mm", "5 mm", "10 mm"),
        rows,
    )


def test_milliseconds_with_time_stamps(keep):
    place = (4_000, -5_000, 4_000)
    world = World(3, bias_sigma_mm=5)
    world.share_a_clock()
    session = world.session(world.claim(place, START_MS), min_assurance=3)
    rows = []
    for frames in (10, 40, 100, 160):
        evidence = world.evidence(lambda t: place, lambda t: place, rounds=frames)
        took = {}
        for name, brought in (
            ("ranges only", evidence),
            ("with time stamps", replace(evidence, time_stamps=world.stamps(lambda t: place, frames=frames))),
        ):
            times = []
            for _ in range(30):
                start = time.thread_time()
                verdict = decide(
                    session,
                    world.commissioning,
                    brought,
                    confirmed=True,
                    signature_valid=True,
                    authorisation=(),
                    now_ms=START_MS + 20_000,
                    evidence_sha256="0" * 64,
                )
                times.append((time.thread_time() - start) * 1e3)
            took[name] = min(times)
        assert verdict.outcome != "refuted"
        octets = len(brought.encode()) - len(evidence.encode())
        rows.append((frames, f"{took['ranges only']:.2f}", f"{took['with time stamps']:.2f}", octets))
        keep(frames=frames, octets=octets, **{name.replace(" ", "_"): value for name, value in took.items()})
    assert (verdict.outcome, verdict.assurance) == ("verified", 3)
    show(
        "A verdict at 4 anchors; least ms of processor time, and octets of the time stamps",
        ("frames", "ranges", "both", "octets"),
        rows,
    )
