"""``wonderland backend`` with the ledger or the server: serve, rebuild, the audit log, the description."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from wonderland.log_lines import set_up_log
from wonderland_backend.audit.anchors import instance_of
from wonderland_backend.audit.verify import verify
from wonderland_backend.database_commands import database_option, json_option, print_digest, require_tables, run_work
from wonderland_backend.db import migrate as migrations
from wonderland_backend.db.engine import Database
from wonderland_backend.description import openapi
from wonderland_backend.http.times import now_ms
from wonderland_backend.leader_election.lock import held
from wonderland_backend.listening import Listen
from wonderland_backend.mirror import rebuild as rebuilding
from wonderland_backend.routes import new_app
from wonderland_backend.serve import audit_anchors, serve, source_of
from wonderland_backend.settings import Settings

_connection = click.option(
    "--connection", type=click.Path(path_type=Path), metavar="PATH", help="The ledger's connection.json."
)
_identity = click.option("--identity", metavar="NAME", help="Which of its identities reads the blocks. [mirror]")


@click.command("serve")
@_connection
@_identity
@database_option
@click.option("--listen", metavar="HOST:PORT", help="Port 0: any free one. [127.0.0.1:8080]")
@click.option(
    "--console", type=click.Path(path_type=Path), metavar="DIR", help="The built console, if not the usual one."
)
@click.option(
    "--map",
    "map_archive",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="PMTiles archive that the console's map is drawn from.",
)
@click.option("--public-url", metavar="URL", help="The address that people use, when a proxy stands before this.")
@click.option(
    "--plaintext", is_flag=True, help="Let other machines reach it by http, in a network that is protected otherwise."
)
@click.option(
    "--token-file", type=click.Path(path_type=Path), metavar="FILE", help="Write the one-time token there, too."
)
@click.option("--test-harness", is_flag=True, help="Open the interfaces by which InterUSS tests a system.")
@click.option("--demo", is_flag=True, help="Say in the console that this is a demo; loopback only.")
@click.option(
    "--demo-registrar",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="With --demo: the ledger's directory, so that visitors get a signing key at a click.",
)
@json_option
def serve_command(
    token_file: Path | None,
    map_archive: Path | None,
    *,
    plaintext: bool,
    test_harness: bool,
    demo: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Serve until told to stop (SIGTERM, Ctrl-C).

    There is no default account. The first start prints a link that serves once: through it the first administrator
    names herself and registers a passkey; until then everything else is refused. `wonderland backend link` prints
    another one. With --demo the link signs in at once.
    """

    async def run(settings: Settings) -> None:
        set_up_log(settings.log_level.upper())
        await serve(settings, Listen.parse(settings.listen), token_file=token_file, as_json=as_json)

    uspace = {"test_harness": True} if test_harness else None
    flags = {"demo": demo or None, "plaintext": plaintext or None}
    run_work(run, uspace=uspace, map=map_archive and {"archive": map_archive}, **flags, **options)


@click.command("rebuild")
@_connection
@_identity
@database_option
@json_option
def rebuild_command(*, as_json: bool, **options: Any) -> None:
    """Drop every row that was derived from the ledger and read all blocks again; stop the backend first.

    What agents reported stays. Prints the digest of the tables before and after: equal, when the database was what
    the ledger says.
    """

    async def run(settings: Settings) -> None:
        database = Database(settings.database)
        progress = Progress(
            TextColumn("Reading blocks"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            disable=as_json,
        )
        try:
            async with held(settings.database):
                await migrations.migrate(database)
                before = await rebuilding.digest(database)
                async with source_of(settings, database) as (connection, source):
                    with progress:
                        task = progress.add_task("blocks")
                        await rebuilding.rebuild(
                            database,
                            source,
                            channel=connection.channel,
                            chaincode=connection.chaincode,
                            batch_transactions=settings.mirror_batch_transactions,
                            on_progress=lambda done, of: progress.update(task, completed=done, total=of),
                        )
                after = await rebuilding.digest(database)
        finally:
            await database.close()
        if as_json:
            click.echo(json.dumps({"before": before.to_json(), "after": after.to_json()}))
        else:
            print_digest(after)
            same = "the same as before" if before == after else f"before it was {before.sha256}"
            click.echo(f"This is {same}.")

    run_work(run, **options)


@click.group("audit")
def audit() -> None:
    """The audit log: who did or read what."""


@audit.command("verify")
@_connection
@_identity
@database_option
@json_option
def audit_verify_command(*, as_json: bool, **options: Any) -> None:
    """Check each row against its hash and the row before, and with --connection against the heads on the ledger.

    Exit code 1 when the log is not what it was.
    """

    async def run(settings: Settings) -> None:
        database = Database(settings.database)
        try:
            await require_tables(database)
            async with audit_anchors(settings, await instance_of(database)) as anchors:
                found = await verify(database, anchors, now_ms())
        finally:
            await database.close()
        click.echo(json.dumps(found.to_json()) if as_json else found.to_text())
        if not found.ok:
            raise click.exceptions.Exit(1)

    run_work(run, **options)


@click.command("openapi")
def openapi_command() -> None:
    """Print the REST interface's description (OpenAPI 3.1), the same bytes each time."""
    document = openapi(new_app(Settings(), frozenset(), None))
    click.echo(json.dumps(document, indent=2, ensure_ascii=False))
