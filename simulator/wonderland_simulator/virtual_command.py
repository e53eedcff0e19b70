"""``wonderland uwb virtual``: boards that are none, on ports like a real one's, to walk a guide's steps without any."""

from __future__ import annotations

import asyncio
import contextlib
import math
import random
import signal
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import click

from wonderland_edge_agent.commissioning.errors import SurveyError
from wonderland_edge_agent.commissioning.survey_files import load_survey
from wonderland_simulator.uci_node import DWM3001CDK, IDEAL, QM35, SR150, Air, Measurement, PtyPort, VirtualNode

NOISE_MM: Final = 20.0
DRONE: Final = "drone"
_METRES_PER_SECOND: Final = 299_792_458.0
_TICKS_PER_SECOND: Final = 63_897_600_000
_PROFILES: Final = {profile.name: profile for profile in (DWM3001CDK, QM35, SR150, IDEAL)}
Place = tuple[float, float, float]


class StandingAir:
    """The air between boards that stand still (``places``: east, north, up in m by name)."""

    def __init__(self, places: Mapping[str, Place], rng: random.Random) -> None:
        self._places = places
        self._rng = rng
        self._drawn: dict[tuple[frozenset[str], float], int] = {}
        self.air = Air(self._measure, stamp=self._stamp, reach=self._reach, rng=rng)

    def _reach(self, one: str, other: str) -> int:
        return round(math.dist(self._places[one], self._places[other]) * 1_000)

    def _measure(self, observer: str, peer: str, t_s: float) -> Measurement:
        """Both ends of a round report the same range."""
        key = frozenset((observer, peer)), t_s
        if key not in self._drawn:
            if len(self._drawn) > 1_000:
                self._drawn.clear()
            self._drawn[key] = round(max(0.0, self._reach(observer, peer) + self._rng.gauss(0, NOISE_MM)))
        return Measurement(self._drawn[key], nlos=False)

    def _stamp(self, anchor: str, tag: str, t_s: float) -> int:
        away_m = (self._reach(anchor, tag) + self._rng.gauss(0, NOISE_MM)) / 1_000
        return round((t_s + away_m / _METRES_PER_SECOND) * _TICKS_PER_SECOND) % 2**40


def _place(_: click.Context, __: click.Parameter, value: str) -> Place:
    try:
        east, north, up = (float(each) for each in value.split(","))
    except ValueError:
        raise click.BadParameter(f"{value!r} is not EAST,NORTH,UP in metres, for example 4,3,6") from None
    if not all(map(math.isfinite, (east, north, up))):
        raise click.BadParameter(f"{value!r}: not all of these are finite")
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
@click.option("--profile", type=click.Choice(list(_PROFILES)), default=DWM3001CDK.name, show_default=True)
@click.option(
    "--directory",
    default="boards",
    show_default=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="The ports appear here.",
)
def virtual(*, anchors: Path, drone: Place, profile: str, directory: Path) -> None:
    """Open ports with virtual UCI boards behind them, of a pad's anchors and a drone, until Ctrl-C.

    They answer and refuse as boards of that kind do, range each other with 20 mm of noise, and stand still: a
    calibration run, which needs a drone that moves, cannot be walked with them. No proof with them proves anything.
    """
    try:
        places: dict[str, Place] = {each.anchor_id: each.place_m for each in load_survey(anchors).anchors}
    except SurveyError as error:
        raise click.ClickException(str(error)) from error
    if DRONE in places:
        raise click.ClickException(f"{anchors}: an anchor is called {DRONE!r}, which is the drone's board here")
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise click.ClickException(f"{directory}: {error.strerror or error}") from error
    asyncio.run(run_boards(places | {DRONE: drone}, profile, directory.absolute(), click.echo))


async def run_boards(places: Mapping[str, Place], profile: str, directory: Path, say: Callable[[Any], None]) -> None:
    """Ports ``tty-NAME`` in ``directory``, until SIGINT, SIGTERM or cancelled."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    air = StandingAir(places, random.Random()).air
    with contextlib.ExitStack() as stack:
        stack.callback(air.close)
        for name, place in places.items():
            port = PtyPort(VirtualNode(name, air, profile=_PROFILES[profile]), directory / f"tty-{name}")
            stack.callback(port.close)
            port.plug()
            say(f"{name}: {port.path} at {', '.join(f'{each:g}' for each in place)} m")
        say(f"Virtual boards of kind {profile}. Ctrl-C takes them away.")
        await stop.wait()
