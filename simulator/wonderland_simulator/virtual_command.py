"""``wonderland uwb virtual``: boards that are none, on ports like a real one's, to walk a guide's steps without any."""

from __future__ import annotations

import asyncio
import contextlib
import math
import random
import signal
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, TextIO

import click

from wonderland_edge_agent.commissioning.errors import SurveyError
from wonderland_edge_agent.commissioning.survey_files import load_survey
from wonderland_fira_uci.dwm1001 import BoardPosition
from wonderland_simulator.dwm1001_node import VirtualAnchor, VirtualDwm1001
from wonderland_simulator.uci_node import DWM3001CDK, Air, Measurement, PtyPort, VirtualNode
from wonderland_simulator.uci_node.profiles import PROFILES
from wonderland_simulator.uci_node.pty import PortDevice

NOISE_MM: Final = 20.0
DRONE: Final = "drone"
_METRES_PER_SECOND: Final = 299_792_458.0
_TICKS_PER_SECOND: Final = 63_897_600_000
DWM1001: Final = "DWM1001"
DRONE_ADDRESS: Final = 0x1A2B
_PAD_ADDRESS: Final = 0x2000
_STEP_S: Final = 0.02
_ROUND_S: Final = 25.0
Place = tuple[float, float, float]


class BoardsAir:
    """The air between boards (``places``: east, north, up in m by name, where they are now)."""

    def __init__(self, places: Mapping[str, Place], rng: random.Random) -> None:
        self._places = places
        self._rng = rng
        self._drawn: dict[tuple[frozenset[str], float], int] = {}
        self.air = Air(self.measure, stamp=self._stamp, reach=self._reach, rng=rng)

    def _reach(self, one: str, other: str) -> int:
        return round(math.dist(self._places[one], self._places[other]) * 1_000)

    def measure(self, observer: str, peer: str, t_s: float) -> Measurement:
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
@click.option("--profile", type=click.Choice([*PROFILES, DWM1001]), default=DWM3001CDK.name, show_default=True)
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
def virtual(*, anchors: Path, drone: Place, profile: str, directory: Path, carry: Path | None) -> None:
    """Open ports with virtual boards behind them, of a pad's anchors and a drone, until Ctrl-C.

    They answer and refuse as boards of that kind do, and range each other with 20 mm of noise. DWM1001 come as out of
    the box: `wonderland uwb prepare` gives them their roles. The drone stands still, unless it is carried: the file is
    the --reference of a calibration run. No proof with them proves anything.
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
    try:
        asyncio.run(run_boards(places | {DRONE: drone}, profile, directory.absolute(), click.echo, carry))
    except OSError as error:
        raise click.ClickException(f"{error.filename or carry}: {error.strerror or error}") from error


async def run_boards(
    places: dict[str, Place],
    profile: str,
    directory: Path,
    say: Callable[[Any], None],
    carry: Path | None = None,
) -> None:
    """Ports ``tty-NAME`` in ``directory``, until SIGINT, SIGTERM or cancelled. Raises OSError."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    between = BoardsAir(places, random.Random())
    async with contextlib.AsyncExitStack() as stack:
        stack.callback(between.air.close)
        if carry is not None:
            file = stack.enter_context(carry.open("w", encoding="utf-8"))
            carrying = asyncio.create_task(_carry(places, file))
            stack.callback(carrying.cancel)
        for index, (name, place) in enumerate(places.items()):
            board = _dwm1001(name, index, between) if profile == DWM1001 else _uci(name, profile, between)
            port = PtyPort(board, directory / f"tty-{name}")
            stack.callback(port.close)
            port.plug()
            say(f"{name}: {port.path} at {', '.join(f'{each:g}' for each in place)} m")
        say(f"Virtual boards of kind {profile}. Ctrl-C takes them away.")
        await stop.wait()


def _uci(name: str, profile: str, between: BoardsAir) -> PortDevice:
    return VirtualNode(name, between.air, profile=PROFILES[profile])


def _dwm1001(name: str, number: int, between: BoardsAir) -> PortDevice:
    """An anchor that has no network yet, as the factory ships them."""
    drone = VirtualAnchor(DRONE_ADDRESS, DRONE, BoardPosition(0, 0, 0))
    board = VirtualDwm1001(
        name,
        [] if name == DRONE else [drone],
        between.measure,
        rng=random.Random(),
        address=DRONE_ADDRESS if name == DRONE else _PAD_ADDRESS + number,
    )
    board.mode = "an"
    return board


async def _carry(places: dict[str, Place], file: TextIO) -> None:
    """The drone on its way round the anchors' middle, near and far, high and low; and where a reference saw it."""
    anchors = [place for name, place in places.items() if name != DRONE]
    middle_east, middle_north = (sum(place[axis] for place in anchors) / len(anchors) for axis in (0, 1))
    reach = max(math.dist(place[:2], (middle_east, middle_north)) for place in anchors)
    file.write("t,x,y,z\n")
    begun_s = time.time()
    while True:
        now_s = time.time()
        angle = (now_s - begun_s) / _ROUND_S * 2 * math.pi
        away = reach * (1.2 + 0.8 * math.cos(2.7 * angle))
        east, north = middle_east + away * math.cos(angle), middle_north + away * math.sin(angle)
        up = 3 + 2 * math.sin(1.9 * angle)
        places[DRONE] = (east, north, up)
        file.write(f"{now_s:.3f},{east:.4f},{north:.4f},{up:.4f}\n")
        file.flush()
        await asyncio.sleep(_STEP_S)
