"""Runs with truth, made by the simulator's channel: four anchors with a bias of their own, a drone that flies about."""

from __future__ import annotations

import csv
import math
import random

import numpy as np
import pytest

from wonderland_edge_agent.commissioning import offline, perform
from wonderland_edge_agent.commissioning.run import make_run
from wonderland_simulator.channel import Channel, bias_m

ANCHORS = {"A1": (1.6, 1.6, 1.6), "A2": (-1.6, 1.6, 0.25), "A3": (-1.6, -1.6, 0.25), "A4": (1.6, -1.6, 0.25)}
OWN_BIAS_M = (0.03, -0.02, 0.0, 0.015)


def place_at(t_s: float, seconds: float, reach_m: float = 20.0) -> tuple[float, float, float]:
    """A spiral from 3 m outwards and back, three times around, between 1 and 5 m high."""
    share = t_s / seconds
    radius = 3.0 + (reach_m - 3.0) * (1 - abs(2 * share - 1))
    angle = 6 * math.pi * share
    return (radius * math.cos(angle), radius * math.sin(angle), 3.0 + 2.0 * math.sin(7 * share * math.pi))


class World:
    """Draws ranges as the simulator's radio does."""

    place_at = staticmethod(place_at)

    def __init__(self, seed: int = 1, anchors=None, bias=OWN_BIAS_M, **channel) -> None:
        self.anchors = anchors or ANCHORS
        macs = dict(enumerate(bias))
        self.channel = Channel(random.Random(seed), anchor_bias_m=macs, **channel)

    def rows(self, seconds: float, *, interval_s: float = 0.05, reach_m: float = 20.0, late_s: float = 0.0):
        """(t, anchor, range, gt): the truth written beside a range is ``late_s`` old."""
        for step in range(int(seconds / interval_s)):
            t_s = step * interval_s
            truth = place_at(t_s, seconds, reach_m)
            told = place_at(max(t_s - late_s, 0.0), seconds, reach_m)
            for index, (name, place) in enumerate(self.anchors.items()):
                found = self.channel.measure(math.dist(truth, place), index)
                if found.range_m is not None:
                    yield (t_s, name, found.range_m, told)

    def run(self, seconds: float = 120.0, name: str = "run", **more):
        rows = list(self.rows(seconds, **more))
        times = sorted({row[0] for row in rows})
        names = tuple(self.anchors)
        position = {t_s: index for index, t_s in enumerate(times)}
        ranges = np.full((len(times), len(names)), np.nan)
        truth = np.zeros((len(times), 3))
        for t_s, anchor, range_m, told in rows:
            ranges[position[t_s], names.index(anchor)] = range_m
            truth[position[t_s]] = told
        return make_run(name, names, np.array(list(self.anchors.values())), np.array(times), truth, ranges)

    def files(self, directory, seconds: float = 120.0, prefix: str = "", **more):
        """ranges.csv and anchors.csv."""
        ranges, anchors = directory / f"{prefix}ranges.csv", directory / f"{prefix}anchors.csv"
        with ranges.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("t", "anchor", "range", "gt_x", "gt_y", "gt_z"))
            for t_s, anchor, range_m, told in self.rows(seconds, **more):
                writer.writerow((f"{t_s:.3f}", anchor, f"{range_m:.3f}", *(f"{value:.4f}" for value in told)))
        with anchors.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("anchor", "x", "y", "z"))
            writer.writerows((name, *place) for name, place in self.anchors.items())
        return ranges, anchors


def true_bias_m(distance_m: float, index: int) -> float:
    return bias_m(distance_m) + OWN_BIAS_M[index]


@pytest.fixture
def make_world():
    return World


@pytest.fixture
def true_bias():
    return true_bias_m


@pytest.fixture(scope="session")
def fitted():
    """One good fit, made once: it takes a second."""
    from wonderland_edge_agent.commissioning.fit import fit_runs

    return fit_runs([World().run()])


@pytest.fixture(scope="session")
def good_run():
    """Two minutes as they should be."""
    return World().run()


@pytest.fixture(scope="session")
def files(tmp_path_factory):
    """ranges.csv and anchors.csv of a minute and a half."""
    return World().files(tmp_path_factory.mktemp("run"), 90.0)


_CALIBRATED: dict = {}


@pytest.fixture
def calibrated_once(monkeypatch):
    """The command with the same files and settings again is given what was found: it takes seconds, each time the same.

    What a test is about then is what the command reads, says and writes of it.
    """

    def calibrate(settings, now_ms):
        files = (*settings.recordings, settings.anchors, settings.reference, *settings.time_stamps, settings.control)
        asked = (settings, *(path.read_bytes() for path in files if path is not None))
        if asked not in _CALIBRATED:
            _CALIBRATED[asked] = offline.calibrate(settings, now_ms)
        return _CALIBRATED[asked]

    monkeypatch.setattr(perform, "calibrate", calibrate)
