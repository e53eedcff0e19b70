"""``wonderland registry move``: from the ledger on which things were tried out to the one that is shared."""

from __future__ import annotations

import json
import time
from collections import Counter
from pathlib import Path

import click

from wonderland.proof_contract import ProofContract
from wonderland.registry.changes import DIFFERS, NEW, REFUSED, Change, submit_all
from wonderland.registry.moving import Person, Plan, planned
from wonderland.registry.session import Ledger, book_of, of_a_ledger, progress


@click.command()
@click.option(
    "--from",
    "source",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="connection.json of the former ledger.",
)
@click.option("--from-identity", default="mirror", show_default=True, metavar="NAME", help="Who reads it.")
@of_a_ledger
@click.option("--dry-run", is_flag=True, help="Say what would be submitted, and submit nothing.")
@click.option("--json", "as_json", is_flag=True, help="A line of JSON for each entry.")
def move(*, source: Path, from_identity: str, ledger: Ledger, dry_run: bool, as_json: bool) -> None:
    """Register on this ledger what holds on a former one: what the identity may, and say who may do the rest.

    \b
    Each person runs it once, the operators first; whoever proposes policies, before the one who grants authorisations:
      wonderland registry move --from former/connection.json --connection connection.json --identity pad_operator
      …                                                                                   --identity fleet_operator
      …                                                                                   --identity admin
      …                                                                                   --identity inspector
    Pads with their commissioning, drones with maintenance and suspension, closures and policies, and then, once all
    that limits them is in force, authorisations. What was retired, revoked or has ended is not moved, and neither is
    what happened: keep the former ledger. It may be run again at any time. Exit code 1 where something differs or was
    refused.
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    former = Ledger(source, from_identity).run(book_of)
    who = ledger.who()
    counts: Counter[str] = Counter()

    def told(change: Change) -> None:
        counts[change.state] += 1
        if as_json:
            click.echo(json.dumps(change.to_json() | {"function": type(change.argument).__name__}, ensure_ascii=False))
        elif change.state in {DIFFERS, REFUSED} or dry_run:
            click.echo(f"{change.id}: {change.state}{': ' if change.why else ''}{change.why}")

    async def work(contract: ProofContract) -> Plan:
        plan = planned(former, await book_of(contract), Person(who.msp_id, who.role), time.time_ns() // 1_000_000)
        with progress() as shown:
            task = shown.add_task("Submitting", total=plan.to_do)
            for stage in plan.stages:
                for each in stage:
                    if each.state != NEW or dry_run:
                        told(each)
                if not dry_run:
                    await submit_all(contract, [each for each in stage if each.state == NEW], None, told)
                    shown.advance(task, sum(each.state == NEW for each in stage))
        return plan

    plan = ledger.run(work)
    click.echo(", ".join(f"{number} {state}" for state, number in counts.items()) or "nothing", err=True)
    for name, number in plan.left.items():
        click.echo(f"left for {name}: {number}", err=True)
    for what, number in plan.lost.items():
        click.echo(f"not moved: {number} {what}", err=True)
    if plan.first:
        more = f" and {len(plan.first) - 5} more" if len(plan.first) > 5 else ""
        click.echo(f"authorisations wait until these are in force: {', '.join(plan.first[:5])}{more}", err=True)
    if counts[REFUSED] or counts[DIFFERS]:
        raise click.exceptions.Exit(1)
