"""``wonderland backend serve`` and what else there is to do with a backend and its database."""

from __future__ import annotations

import asyncio
import json
import secrets
import urllib.error
import urllib.request
from collections.abc import Callable, Coroutine
from http import HTTPStatus
from pathlib import Path
from typing import Any

import click
import uvloop
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from wonderland_backend.app import now_ms
from wonderland_backend.audit.anchors import instance_of
from wonderland_backend.audit.verify import verify
from wonderland_backend.auth.store.sign_ins import SignIns
from wonderland_backend.db import migrate as migrations
from wonderland_backend.db import passwords
from wonderland_backend.db.engine import Database
from wonderland_backend.description import openapi
from wonderland_backend.errors import TYPE_BASE, BackendError
from wonderland_backend.leader_election.lock import held
from wonderland_backend.leader_election.standby import STANDBY
from wonderland_backend.mirror import rebuild as rebuilding
from wonderland_backend.mirror.rebuild import Digest
from wonderland_backend.people import links
from wonderland_backend.routes import new_app
from wonderland_backend.serve import Listen, audit_anchors, serve, setup_logging, source_of
from wonderland_backend.settings import Settings, load
from wonderland_fabric_gateway.errors import LedgerError

HEALTH_TIMEOUT_S = 5

_database = click.option(
    "--database", metavar="URL", help="sqlite:///file.db (the default: wonderland.db here) or postgresql://user@host/db"
)
_connection = click.option(
    "--connection", type=click.Path(path_type=Path), metavar="PATH", help="The ledger's connection.json."
)
_identity = click.option("--identity", metavar="NAME", help="Which of its identities reads the blocks. [mirror]")
_json = click.option("--json", "as_json", is_flag=True, help="For machines.")


@click.command("serve")
@_connection
@_identity
@_database
@click.option(
    "--listen", default="127.0.0.1:8080", show_default=True, metavar="HOST:PORT", help="Port 0: any free one."
)
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
@_json
def serve_command(
    listen: str,
    token_file: Path | None,
    map_archive: Path | None,
    *,
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
        setup_logging(settings.log_level)
        await serve(settings, Listen.parse(listen), token_file=token_file, as_json=as_json)

    uspace = {"test_harness": True} if test_harness else None
    _run(run, demo=demo or None, uspace=uspace, map=map_archive and {"archive": map_archive}, **options)


@click.command("link")
@_database
@click.option("--name", help="Which administrator; not needed where there is only one.")
@click.option("--display", metavar="NAME", help="For a screen that nobody operates: it may look, nothing else.")
@_json
def link_command(name: str | None, display: str | None, *, as_json: bool, **options: Any) -> None:
    """Print a one-time token for an administrator who has lost every other sign-in method, or for a display.

    On a server that nobody has set up: for the first administrator, to set it up with a passkey or by single sign-on;
    with --name the first administrator has that name and is signed in at once.

    With --display it signs a wall display in as a viewer of this name, for 30 days and however long nobody touches it.
    """
    if name is not None and display is not None:
        raise click.UsageError("--name is for an administrator, --display for a screen: give one of them")

    async def run(settings: Settings) -> None:
        database = Database(settings.database)
        try:
            await _require_tables(database)
            sign_ins = SignIns(database, settings, now_ms, secrets.token_bytes)
            if display is not None:
                token = await links.for_display(database, sign_ins, display, now_ms())
            else:
                token = await links.for_administrator(database, sign_ins, name, now_ms())
        finally:
            await database.close()
        if as_json:
            click.echo(json.dumps({"token": token, "expires_s": settings.token_ttl_s}))
        else:
            click.echo(
                f"Append to the console's address, once, within {settings.token_ttl_s // 60} min:  #token={token}"
            )

    _run(run, **options)


@click.command("new-password")
@click.option(
    "--to",
    "directory",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Where to write it; what is there already stays.",
)
@click.option("--user", default="wonderland", show_default=True, help="The database's user that has it.")
def new_password_command(directory: Path, user: str) -> None:
    """Make a random password for the database, and a token for /metrics.

    DIR/password is for PostgreSQL (its image takes it by POSTGRES_PASSWORD_FILE), DIR/pgpass for this backend
    (--database 'postgresql://USER@HOST/NAME?passfile=DIR/pgpass'); DIR/metrics-token is for Prometheus and, by
    WONDERLAND_BACKEND_METRICS_TOKEN_FILE, for this backend.
    """
    try:
        passwords.ensure_token(directory, secrets.token_urlsafe(passwords.BYTES))
        made = passwords.ensure(directory, user, secrets.token_urlsafe(passwords.BYTES))
    except (LedgerError, OSError) as error:
        raise click.ClickException(f"{directory}: {error}") from error
    click.echo(f"{directory} has a new password." if made else f"{directory} has a password already; it stays.")


@click.command("health")
@click.option("--at", "url", required=True, metavar="URL", help="The backend, for example http://127.0.0.1:8080")
def health_command(url: str) -> None:
    """Ask a running backend whether it serves, or stands by. Exit code 1 when it does neither."""
    if not url.startswith(("http://", "https://")):
        raise click.UsageError(f"--at: {url!r} is no address, for example http://127.0.0.1:8080")
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(f"{url.rstrip('/')}/api/v1/health", timeout=HEALTH_TIMEOUT_S) as answer:
            click.echo(answer.read(4096).decode(errors="replace"))
    except urllib.error.HTTPError as refusal:
        if refusal.code != HTTPStatus.SERVICE_UNAVAILABLE or TYPE_BASE + STANDBY not in (
            said := refusal.read(4096).decode()
        ):
            raise click.ClickException(f"the backend at {url} answers {refusal.code}; see its log") from None
        click.echo(said)
    except (OSError, ValueError) as error:
        raise click.ClickException(f"no backend answers at {url} ({error}); does it run?") from error


@click.command("migrate")
@_database
@_json
def migrate_command(*, as_json: bool, **options: Any) -> None:
    """Bring the database's tables to this version. `serve` does it by itself."""

    async def run(settings: Settings) -> None:
        database = Database(settings.database)
        try:
            before = await migrations.revision(database)
            await migrations.migrate(database)
            after = await migrations.revision(database)
        finally:
            await database.close()
        if as_json:
            click.echo(json.dumps({"before": before, "after": after}))
        else:
            click.echo(f"The tables are at revision {after}" + (" already." if before == after else "."))

    _run(run, **options)


@click.command("rebuild")
@_connection
@_identity
@_database
@_json
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
                async with source_of(settings) as (connection, source):
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
            _print_digest(after)
            same = "the same as before" if before == after else f"before it was {before.sha256}"
            click.echo(f"This is {same}.")

    _run(run, **options)


@click.command("digest")
@_database
@_json
def digest_command(*, as_json: bool, **options: Any) -> None:
    """Print a digest of the tables that are derived from the ledger; equal content, equal digest."""

    async def run(settings: Settings) -> None:
        database = Database(settings.database)
        try:
            await _require_tables(database)
            found = await rebuilding.digest(database)
        finally:
            await database.close()
        if as_json:
            click.echo(json.dumps(found.to_json()))
        else:
            _print_digest(found)

    _run(run, **options)


@click.group("audit")
def audit() -> None:
    """The audit log: who did or read what."""


@audit.command("verify")
@_connection
@_identity
@_database
@_json
def audit_verify_command(*, as_json: bool, **options: Any) -> None:
    """Check each row against its hash and the row before, and with --connection against the heads on the ledger.

    Exit code 1 when the log is not what it was.
    """

    async def run(settings: Settings) -> None:
        database = Database(settings.database)
        try:
            await _require_tables(database)
            async with audit_anchors(settings, await instance_of(database)) as anchors:
                found = await verify(database, anchors, now_ms())
        finally:
            await database.close()
        click.echo(json.dumps(found.to_json()) if as_json else found.to_text())
        if not found.ok:
            raise click.exceptions.Exit(1)

    _run(run, **options)


@click.command("openapi")
def openapi_command() -> None:
    """Print the REST interface's description (OpenAPI 3.1), the same bytes each time."""
    document = openapi(new_app(Settings(), frozenset(), None))
    click.echo(json.dumps(document, indent=2, ensure_ascii=False))


async def _require_tables(database: Database) -> None:
    if not database.exists():
        raise BackendError(f"--database: there is no file {database.url.database}")
    if await migrations.revision(database) != migrations.head():
        raise BackendError("the database is of another version; run `wonderland backend migrate`")


def _print_digest(found: Digest) -> None:
    width = max(map(len, found.tables))
    for name, each in found.tables.items():
        click.echo(f"{name:<{width}}  {each.rows:>9} rows  {each.sha256[:16]}")
    click.echo(f"{'all':<{width}}  {'':>9}       {found.sha256}")


def _run(work: Callable[[Settings], Coroutine[Any, Any, None]], **options: Any) -> None:
    """Run with uvloop; an error that we raise on purpose is one line for people."""
    try:
        settings = load(**options)
        with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
            runner.run(work(settings))
    except (BackendError, LedgerError) as error:
        raise click.ClickException(str(error)) from error
