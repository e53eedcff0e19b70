"""``wonderland uwb virtual``: boards that are none, on ports like a real one's, to walk a guide's steps without any.

It is a scenario (``wonderland_simulator.practice``) of one pad and one drone that says nothing.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, get_args

import click
from rich.console import Console

from wonderland_edge_agent.commissioning.errors import SurveyError
from wonderland_edge_agent.commissioning.survey_files import NOWHERE, load_survey
from wonderland_simulator.flight import Vector
from wonderland_simulator.practice.description import NodeKind, Origin, Pad, RemoteId, ScenarioFile, Vehicle, Waypoint
from wonderland_simulator.practice.reading import Scenario, complete
from wonderland_simulator.practice.run import run_scenario

DRONE: Final = "drone"
FARTHEST_M: Final = 100
_PAD: Final = "pad"
_CLOCK_SIGMA_MM: Final = 5
_LEGS: Final = 48
_ROUNDS: Final = 4
_SLOWEST_M_S: Final = 1.5


def _place(_: click.Context, __: click.Parameter, value: str) -> Vector:
    try:
        east, north, up = (float(each) for each in value.split(","))
    except ValueError:
        raise click.BadParameter(f"{value!r} is not EAST,NORTH,UP in metres, for example 4,3,6") from None
    if not all(map(math.isfinite, (east, north, up))):
        raise click.BadParameter(f"{value!r}: not all of these are finite")
    if max(map(abs, (east, north, up))) > FARTHEST_M:
        raise click.BadParameter(f"{value!r}: more than {FARTHEST_M} m away; boards do not reach so far")
    return east, north, up


@click.command()
@click.option(
    "--anchors",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="CSV|TOML",
    help="The survey: a board stands at each anchor.",
)
@click.option("--drone", default="4,3,6", show_default=True, callback=_place, metavar="E,N,U", help="Where it is, m.")
@click.option(
    "--profile",
    type=click.Choice(get_args(NodeKind)),
    default="DWM3001CDK",
    show_default=True,
    help="Which boards they are.",
)
@click.option(
    "--directory",
    default="boards",
    show_default=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="The ports appear here.",
)
@click.option(
    "--carry",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="CSV",
    help="Carry the drone about, as in a calibration run, and write here where it was (t, x, y, z).",
)
def virtual(*, anchors: Path, drone: Vector, profile: NodeKind, directory: Path, carry: Path | None) -> None:
    """Open ports with virtual boards behind them, of a pad's anchors and a drone, until Ctrl-C.

    They answer and refuse as boards of that kind do, and range each other with a real board's noise and bias. DWM1001
    come as out of the box: `wonderland uwb prepare` gives them their roles. The drone stands still, unless it is
    carried: the file is the --reference of a calibration run. No proof with them proves anything.

    Drones that fly, Remote ID, liars and faults: `wonderland world run --scenario`.
    """
    try:
        places: dict[str, Vector] = {each.anchor_id: each.place_m for each in load_survey(anchors).anchors}
    except SurveyError as error:
        raise click.ClickException(str(error)) from error
    if DRONE in places:
        raise click.ClickException(f"{anchors}: an anchor is called {DRONE!r}, which is the drone's board here")
    if max(abs(each) for place in places.values() for each in place) > FARTHEST_M:
        raise click.ClickException(f"{anchors}: an anchor is more than {FARTHEST_M} m away; boards do not reach so far")
    way = [drone] if carry is None else list(_round(list(places.values())))
    scenario, problems = _boards(anchors, profile, directory, way, carry)
    if problems:
        raise click.ClickException("\n".join(problems))
    try:
        asyncio.run(run_scenario(scenario, Console(), greeting=list(_greeting(scenario, profile))))
    except OSError as error:
        raise click.ClickException(f"{error.filename or carry}: {error.strerror or error}") from error


def _boards(
    anchors: Path, profile: NodeKind, directory: Path, way: Sequence[Vector], carry: Path | None
) -> tuple[Scenario, list[str]]:
    """The scenario; and what is wrong with it."""
    speed_m_s = max(_SLOWEST_M_S, max(math.dist(one, other) for one in way for other in way) / 10)
    file = ScenarioFile(
        pads=(
            Pad(
                pad_id=_PAD,
                origin=Origin(lat=NOWHERE.lat, lon=NOWHERE.lon, height_m=NOWHERE.height_m),
                survey=anchors.absolute(),
                node=profile,
                ports=directory,
                clock_sigma_mm=_CLOCK_SIGMA_MM,
            ),
        ),
        vehicles=(
            Vehicle(
                uav_id=DRONE,
                pad=_PAD,
                port=directory / f"tty-{DRONE}",
                path=tuple(
                    Waypoint(east_m=east, north_m=north, up_m=up, speed_m_s=min(30.0, speed_m_s))
                    for east, north, up in way
                ),
                repeat=True,
                remote_id=RemoteId(silent=True),
                track=carry,
            ),
        ),
    )
    scenario, problems = complete(file, Path.cwd())
    (vehicle,) = scenario.vehicles
    return replace(scenario, vehicles=(replace(vehicle, position=None),)), [each.text for each in problems]


def _greeting(scenario: Scenario, profile: str) -> Iterator[str]:
    (pad,), (drone,) = scenario.pads, scenario.vehicles
    places = {each.anchor_id: (each.east_m, each.north_m, each.up_m) for each in pad.site.anchors}
    for name, path in (*pad.ports.items(), (DRONE, drone.port)):
        place = places.get(name, drone.spec.away_m)
        yield f"{name}: {path} at {', '.join(f'{each:g}' for each in place)} m"
    yield f"Virtual boards of kind {profile}. Ctrl-C takes them away."


def _round(anchors: Sequence[Vector]) -> Iterator[Vector]:
    """A way round the anchors' middle, near and far, high and low."""
    middle_east, middle_north = (sum(place[axis] for place in anchors) / len(anchors) for axis in (0, 1))
    reach = max(math.dist(place[:2], (middle_east, middle_north)) for place in anchors)
    for leg in range(_LEGS):
        angle = _ROUNDS * 2 * math.pi * leg / _LEGS
        away = reach * (1.2 + 0.8 * math.cos(2.75 * angle))
        east, north = middle_east + away * math.cos(angle), middle_north + away * math.sin(angle)
        yield east, north, 3 + 2 * math.sin(1.75 * angle)
