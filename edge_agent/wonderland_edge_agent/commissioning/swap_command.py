"""``wonderland pad swap-node``: a broken node was replaced in its mount; no new survey, no calibration run."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import sys
from typing import TYPE_CHECKING, Any, Final

import click

from wonderland.clock import SteadyClock
from wonderland.proof_contract import AwayError, ProofContract, RefusedError
from wonderland.toml_settings import SettingsError
from wonderland_edge_agent.commissioning.alone import alone
from wonderland_edge_agent.commissioning.errors import CommissioningError, PublishError, RadioError, SurveyError
from wonderland_edge_agent.commissioning.live.publish import Operator, publish
from wonderland_edge_agent.commissioning.swap import Swapped, swap
from wonderland_edge_agent.config_option import config_option
from wonderland_edge_agent.drift.baseline import Baseline, BaselineError, summary
from wonderland_edge_agent.radios import AnchorPort
from wonderland_edge_agent.radios.between import channel_of, measure_between
from wonderland_edge_agent.settings import PadSettings, load
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fira_uci.errors import UwbError
from wonderland_fira_uci.node import monotonic_ms

if TYPE_CHECKING:
    from pathlib import Path

    from wonderland.proofs.records.pads import Commissioning, Pad

READY_S: Final = 10.0
ROUNDS: Final = 30


@click.command("swap-node")
@config_option
@click.option("--anchor", "anchor_id", required=True, help="The anchor whose node was replaced.")
@click.option(
    "--mount-sigma",
    "mount_mm",
    type=click.FloatRange(0.0, 100.0),
    default=5.0,
    show_default=True,
    metavar="MM",
    help="How well the mount puts the new node where the old one was (1 σ).",
)
@click.option("--identity", default="pad_operator", show_default=True, help="Who signs (connection.json).")
@click.option("--yes", is_flag=True, help="Publish without asking.")
@click.option("--dry-run", is_flag=True, help="Everything but the transaction.")
@click.option("--json", "as_json", is_flag=True, help="One JSON document.")
def swap_node(
    *, path: Path, anchor_id: str, mount_mm: float, identity: str, yes: bool, dry_run: bool, as_json: bool
) -> None:
    """Take a new node into the commissioning in place of a broken one, in the same mount.

    Stop the agent, put the new node in, name its port in pad.toml, call this, start the agent. The new node and its
    neighbours range each other; what it ranges longer or shorter than its predecessor goes into its bias table, and the
    record, signed by the pad's operator, onto the ledger. Nothing is sent where the neighbours' ranges show that more
    has changed than the node, or that it stands elsewhere. Until the next calibration run the pad reaches less far.
    """
    logging.basicConfig(level=logging.WARNING, format="%(message)s", stream=sys.stderr)
    try:
        settings = load(path)
        with alone(settings.spool):
            found = asyncio.run(_measure(settings, identity, anchor_id, mount_mm))
            if not as_json:
                _show(found, anchor_id)
            send = not dry_run and (yes or click.confirm(f"Publish this commissioning of {settings.pad_id}?"))
            done: dict[str, Any] = {"published": False}
            if send:
                operator = Operator(connection=settings.connection, identity=identity)
                done = {"published": True, **asyncio.run(publish(operator, settings.pad_id, found.record))}
                found.baseline.save(settings.baseline_file, done["commissioning_sha256"])
    except (SettingsError, CommissioningError, LedgerError) as error:
        raise click.ClickException(str(error)) from error
    if as_json:
        figures = {
            "delay_mm": round(found.delay_mm),
            "sigma_mm": round(found.sigma_mm),
            "worst_mm": round(found.worst_mm),
            "neighbours": found.neighbours,
            "loses_clock": found.loses_clock,
        }
        click.echo(json.dumps({"pad_id": settings.pad_id, "anchor_id": anchor_id, **figures, **done}))
    elif done["published"]:
        click.echo(f"Committed in block {done['block']}. Start the agent again.")
    else:
        click.echo("Nothing was sent.")


async def _measure(settings: PadSettings, identity: str, anchor_id: str, mount_mm: float) -> Swapped:
    pad = await _pad(settings, identity)
    commissioning = pad.commissioning
    if commissioning is None or pad.commissioning_sha256 is None:
        raise SurveyError(f"pad {pad.pad_id} is not commissioned; wonderland pad commission does that")
    ranges = await _ranges(settings, commissioning, anchor_id)
    clock = SteadyClock()
    try:
        before = Baseline.load(settings.baseline_file, pad.commissioning_sha256)
    except BaselineError as error:
        raise SurveyError(str(error)) from error
    return swap(commissioning, anchor_id, summary(ranges), before, now_ms=clock(), mount_mm=mount_mm)


async def _pad(settings: PadSettings, identity: str) -> Pad:
    try:
        connection = Connection.load(settings.connection)
        who, signer = connection.identity(identity), connection.signer(identity)
        async with connection.open_channel() as channel:
            network = Gateway(channel, who, signer).network(connection.channel)
            return await ProofContract(network, connection.chaincode).read_pad(settings.pad_id)
    except AwayError as error:
        raise PublishError(f"the ledger cannot be reached: {error}") from error
    except RefusedError as error:
        raise PublishError(f"the ledger refuses: {error}") from error


async def _ranges(
    settings: PadSettings, commissioning: Commissioning, anchor_id: str
) -> dict[tuple[str, str], list[int]]:
    """What all nodes that answer measure to each other; the new one has to be among them."""
    macs = {anchor.anchor_id: anchor.mac for anchor in commissioning.anchors}
    async with contextlib.AsyncExitStack() as stack:
        nodes = {
            each.anchor_id: await stack.enter_async_context(AnchorPort.of(each).node(monotonic_ms))
            for each in settings.anchors
        }
        if anchor_id not in nodes:
            raise RadioError(f"pad.toml has no port for anchor {anchor_id}")
        outcomes = await asyncio.gather(*(node.wait_ready(READY_S) for node in nodes.values()), return_exceptions=True)
        away = {name: str(each) for name, each in zip(nodes, outcomes, strict=True) if isinstance(each, UwbError)}
        if anchor_id in away:
            raise RadioError(f"the new node does not answer: {away[anchor_id]}")
        return await measure_between(nodes, macs, rounds=ROUNDS, channel=channel_of(commissioning))


def _show(found: Swapped, anchor_id: str) -> None:
    click.echo(
        f"The new node of {anchor_id} ranges {found.delay_mm:+.0f} mm (±{found.sigma_mm:.0f}) against its predecessor, "
        f"by {found.neighbours} neighbours that agree within {found.worst_mm:.0f} mm."
    )
    (anchor,) = [each for each in found.record.anchors if each.anchor_id == anchor_id]
    worst = max(point.sigma_mm for point in anchor.bias)
    click.echo(f"Its bias is known to {worst} mm until the next calibration run: the pad reaches less far meanwhile.")
    if found.loses_clock:
        click.echo("Its clock is not calibrated: time differences (assurance 3 and 4) go without this anchor.")
