"""``wonderland pad calibrate-uav``: what a drone's own node adds to every range, measured by a running pad."""

from __future__ import annotations

import asyncio
import json
import logging
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from wonderland.clock import SteadyClock
from wonderland.consoles import for_people
from wonderland.proof_contract import AwayError, Committed, ProofContract, RefusedError
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.calibrations import MAX_SESSIONS, RangedAt
from wonderland.toml_settings import SettingsError
from wonderland_edge_agent.commissioning.errors import CommissioningError, PublishError, RadioError, TruthError
from wonderland_edge_agent.commissioning.reference import load_track
from wonderland_edge_agent.config_option import config_option
from wonderland_edge_agent.settings import PadSettings, load
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import Gateway

if TYPE_CHECKING:
    from wonderland.proofs.records.pads import Commissioning
    from wonderland_edge_agent.commissioning.drone_offset import FoundOffset, Place, Ranged

DAY_MS: Final = 86_400_000
TICK_MM: Final = 4.6918
"""What one unit of a DW1000's or DW3000's antenna delays is worth in a range, where both are set by as much."""
FARTHEST_M: Final = 200.0
NOWHERE: Final = (0.0, 0.0, 0.0)
"""Of a drone whose places a reference will tell."""


@dataclass(frozen=True, slots=True)
class Enough:
    """What one place takes: sessions and rounds, at least; and no more sessions than that."""

    sessions: int
    rounds: int
    most: int

    def reached(self, sessions: int, rounds: int) -> bool:
        """Whether it is enough."""
        return sessions >= self.most or (sessions >= self.sessions and rounds >= self.rounds)


class _Coordinates(click.ParamType[Any]):
    name = "E,N,U"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Metres to millimetres."""
        try:
            east, north, up = (float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r}: give three numbers, as 0.30,-0.20,0.15", param, ctx)
        if not all(abs(each) <= FARTHEST_M for each in (east, north, up)):
            self.fail(f"{value!r}: metres in the pad's frame, {FARTHEST_M:.0f} at most", param, ctx)
        return east * 1000.0, north * 1000.0, up * 1000.0


@click.command("calibrate-uav")
@config_option
@click.option("--uav", "uav_id", required=True, help="The drone's serial number.")
@click.option(
    "--at",
    "places",
    multiple=True,
    type=_Coordinates(),
    help="Where its antenna stands, metres in the pad's frame; several times for several places, one after the other.",
)
@click.option(
    "--reference",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Instead of --at, for a drone that hovers: where its antenna was, as `pad commission` takes it; it is read "
    "after the sessions.",
)
@click.option(
    "--at-sigma",
    "reference_mm",
    type=click.FloatRange(1.0, 200.0),
    default=10.0,
    show_default=True,
    metavar="MM",
    help="How well these coordinates are known (1 σ).",
)
@click.option(
    "--sessions",
    type=click.IntRange(1, MAX_SESSIONS),
    default=2,
    show_default=True,
    help="Sessions at each place, at least: until there are 30 rounds together.",
)
@click.option(
    "--wait",
    "wait_s",
    type=click.FloatRange(1.0, 86_400.0),
    default=600.0,
    show_default=True,
    metavar="S",
    help="How long to wait for each session.",
)
@click.option(
    "--from-block",
    type=click.IntRange(0),
    help="Take sessions from this block on, that were before; the places have to be in their order.",
)
@click.option(
    "--valid-days", type=click.IntRange(1, 366), default=365, show_default=True, help="How long the calibration holds."
)
@click.option("--node", default="", metavar="TEXT", help="The drone's node and antenna, for the record.")
@click.option("--identity", default="pad_operator", show_default=True, help="Who signs (connection.json).")
@click.option("--yes", is_flag=True, help="Ask nothing: the drone goes from place to place by itself; register.")
@click.option("--dry-run", is_flag=True, help="Everything but the transaction.")
@click.option("--json", "as_json", is_flag=True, help="One JSON document.")
def calibrate_uav(*, path: Path, as_json: bool, **options: Any) -> None:
    """Measure what a drone's node adds to every range, and register it.

    The pad works as ever (`wonderland pad run`); this command listens to the ledger. The drone stands on a surveyed
    mark, best between the anchors, and asks for proofs: `wonderland uav calibrate` there. Of these sessions the pad's
    ranges are taken, never the drone's word. One offset has to explain all of them; what contradicts that is refused
    with its reason. Who signs must not fly the drone: the pad's operator, or an inspector of the authority.

    \b
      wonderland pad calibrate-uav --config pad.toml --uav 1596F0123 --at 0.30,-0.20,0.15 --at -0.80,0.60,0.15
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    logging.basicConfig(level=logging.WARNING, format="%(message)s", stream=sys.stderr)
    try:
        from wonderland_edge_agent.commissioning.drone_offset import find_offset  # noqa: PLC0415, F401 - the extra
    except ModuleNotFoundError as error:
        text = f"{error.name} is not installed; calibrating needs it: pip install 'wonderland-edge-agent[commission]'"
        raise click.ClickException(text) from error
    try:
        settings = load(path)
        found = asyncio.run(_calibrate(settings, for_people(stderr=as_json), **options))
    except (SettingsError, CommissioningError, LedgerError) as error:
        raise click.ClickException(str(error)) from error
    if as_json:
        click.echo(json.dumps(found))


async def _calibrate(
    settings: PadSettings,
    console: Console,
    *,
    uav_id: str,
    places: tuple[Place, ...],
    reference: Path | None,
    reference_mm: float,
    sessions: int,
    wait_s: float,
    from_block: int | None,
    valid_days: int,
    node: str,
    identity: str,
    yes: bool,
    dry_run: bool,
) -> dict[str, Any]:
    from wonderland_edge_agent.commissioning.drone_offset import MIN_ROUNDS, find_offset  # noqa: PLC0415 - loads numpy

    if (reference is None) != bool(places):
        raise click.UsageError("give either --at, once or several times, or --reference")
    places = places or (NOWHERE,)
    if sessions * len(places) > MAX_SESSIONS:
        raise click.UsageError(f"{sessions} sessions at {len(places)} places; {MAX_SESSIONS} are the most together")
    connection = Connection.load(settings.connection)
    who, signer = connection.identity(identity), connection.signer(identity)
    async with connection.open_channel() as channel:
        contract = ProofContract(Gateway(channel, who, signer).network(connection.channel), connection.chaincode)
        try:
            commissioning, digest = await _commissioned(contract, settings.pad_id)
            uav = await contract.read_uav(uav_id)
            if uav.msp_id == who.msp_id:
                raise PublishError(f"{identity} is of {who.msp_id}, which flies {uav_id}; somebody else has to measure")
            ranged: list[Ranged] = []
            block = from_block
            enough = Enough(sessions, -(-MIN_ROUNDS // len(places)), MAX_SESSIONS // len(places))
            for number, place in enumerate(places):
                where = (
                    f"at {', '.join(f'{each / 1000:+.2f}' for each in place)} m" if reference is None else "hovering"
                )
                live = from_block is None and not yes
                if number and live and not await asyncio.to_thread(click.confirm, f"Does it stand {where}?"):
                    raise RadioError("stopped; nothing was sent")
                if from_block is None:
                    # What it asked before it stood there is left out.
                    block = await contract.height()
                console.print(f"{uav_id} {where}: sessions from block {block} on (wonderland uav calibrate)")
                about = (settings.pad_id, uav_id, digest)
                found_there, block = await _sessions(contract, about, place, enough, block or 0, wait_s, console)
                ranged += found_there
            if reference is not None:
                ranged = _placed(ranged, reference, commissioning)
            found = find_offset(ranged, commissioning, reference_mm=reference_mm)
            _show(found, console)
            document = _document(settings.pad_id, uav_id, found)
            argument = tx.CalibrateUav(
                uav_id=uav_id,
                pad_id=settings.pad_id,
                offset_mm=round(found.offset_mm),
                sigma_mm=found.stated_sigma_mm,
                sessions=tuple(_ranged_at(each) for each in ranged),
                valid_until_ms=SteadyClock()() + valid_days * DAY_MS,
                node=node or None,
            )
            if dry_run or not (yes or await asyncio.to_thread(click.confirm, "Register this calibration?")):
                console.print("Nothing was sent.")
                return document | {"published": False}
            _, done = await contract.calibrate_uav(argument)
        except AwayError as error:
            raise PublishError(f"the ledger cannot be reached: {error}") from error
        except RefusedError as error:
            raise PublishError(f"the ledger refuses: {error}") from error
    console.print(f"Committed in block {done.block_number}.")
    return document | {"published": True, "tx_id": done.tx_id, "block": done.block_number}


async def _commissioned(contract: ProofContract, pad_id: str) -> tuple[Commissioning, str]:
    pad = await contract.read_pad(pad_id)
    if pad.commissioning is None or pad.commissioning_sha256 is None:
        raise PublishError(f"pad {pad_id} is not commissioned; wonderland pad commission does that")
    return pad.commissioning, pad.commissioning_sha256


async def _sessions(
    contract: ProofContract,
    about: tuple[str, str, str],
    place: Place,
    enough: Enough,
    block: int,
    wait_s: float,
    console: Console,
) -> tuple[list[Ranged], int]:
    """Sessions from a block on, ``about`` a pad and a drone under a commissioning, that brought ranges.

    And the block after the last one. Raises RadioError where no more come.
    """
    from wonderland_edge_agent.commissioning.drone_offset import Ranged  # noqa: PLC0415 - loads numpy

    pad_id, uav_id, digest = about
    found: list[Ranged] = []
    rounds = 0
    events = contract.events(start_block=block, names=frozenset({"ProofDecided"}))
    try:
        while not enough.reached(len(found), rounds):
            async with asyncio.timeout(wait_s):
                event = await anext(events)
            record = event.record
            if (record.get("pad_id"), record.get("uav_id")) != (pad_id, uav_id):
                continue
            session = await contract.read_session(str(record.get("session_id")))
            if session.commissioning_sha256 != digest:
                raise RadioError("the pad was commissioned anew meanwhile; begin again")
            if session.calibration is not None and not found:
                console.print("[dim]It is calibrated here already; this will replace it.[/dim]")
            if not int(record.get("assurance", 0)):
                raise RadioError(
                    "the pad's ranges of this drone are tied to nothing, or are its own word (assurance 0): no ground "
                    "for a calibration"
                )
            evidence = await contract.evidence_of(Committed(event.tx_id, event.block_number))
            found.append(Ranged(session.session_id, evidence.ranges, lambda _: place))
            rounds += int(record.get("rounds", 0))
            block = event.block_number + 1
            console.print(
                f"  session {len(found)}, {record.get('outcome')}: {rounds} rounds of {enough.rounds} or more"
            )
    except TimeoutError:
        raise RadioError(
            f"{uav_id} asked for nothing within {wait_s:g} s; run wonderland uav calibrate on it, and see "
            "wonderland pad status"
        ) from None
    finally:
        await events.aclose()
    return found, block


def _placed(sessions: list[Ranged], reference: Path, commissioning: Commissioning) -> list[Ranged]:
    """The sessions with the places of a recorded reference. Raises TruthError where it does not cover one."""
    track = load_track(reference, commissioning.frame)

    def place_at(t_ms: int) -> Place:
        east, north, up = track.at(t_ms / 1000)
        return east * 1000, north * 1000, up * 1000

    for session in sessions:
        times = session.ranges.t_ms
        if not track.t_s[0] <= times[0] / 1000 <= times[-1] / 1000 <= track.t_s[-1]:
            raise TruthError(
                f"{reference}: reaches from {track.t_s[0]:.1f} to {track.t_s[-1]:.1f} s; a session was ranged from "
                f"{times[0] / 1000:.1f} to {times[-1] / 1000:.1f}"
            )
    return [replace(session, place_at=place_at) for session in sessions]


def _ranged_at(session: Ranged) -> RangedAt:
    times = session.ranges.t_ms
    east, north, up = (round(each) for each in session.place_at(times[len(times) // 2]))
    return RangedAt(session_id=session.session_id, east_mm=east, north_mm=north, up_mm=up)


def _document(pad_id: str, uav_id: str, found: FoundOffset) -> dict[str, Any]:
    return {
        "pad_id": pad_id,
        "uav_id": uav_id,
        "offset_mm": round(found.offset_mm),
        "sigma_mm": found.stated_sigma_mm,
        "rounds": found.rounds,
        "chi2": round(found.chi2, 1),
        "chi2_limit": round(found.limit, 1),
        "rests_on_place": found.rests_on_place,
        "by_anchor_mm": {name: round(value) for name, value in found.by_anchor.items()},
        "by_session_mm": {name: round(value) for name, value in found.by_session.items()},
    }


def _show(found: FoundOffset, console: Console) -> None:
    table = Table(box=None, pad_edge=False)
    table.add_column("by")
    table.add_column("ranges longer by", justify="right")
    for names in (found.by_anchor, {f"session {key[:12]}…": value for key, value in found.by_session.items()}):
        for name, value in names.items():
            table.add_row(escape(name), f"{value:+.0f} mm")
    console.print(table)
    console.print(
        f"[bold]{found.offset_mm:+.0f} mm ± {found.stated_sigma_mm} mm[/bold] against the tag with which this pad was "
        f"commissioned, from {found.rounds} rounds; χ² {found.chi2:.0f} (limit {found.limit:.0f})."
    )
    if found.rests_on_place:
        console.print(
            "[yellow]![/yellow] Here a place that was written down wrongly looks like an offset; between the anchors "
            "it would show."
        )
    ticks = round(found.offset_mm / TICK_MM)
    if abs(ticks) >= 1:
        console.print(
            f"[dim]Or set it in the node, for every pad: {ticks:+d} units of each of its two antenna delays "
            "(DW1000, DW3000: 15.65 ps), and calibrate what is left.[/dim]"
        )
