"""``wonderland backend`` on a database alone: links, migrations, digests. None of it imports the server."""

from __future__ import annotations

import asyncio
import json
import secrets
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import click
from sqlalchemy.exc import OperationalError

from wonderland_backend.auth.store.sign_ins import SignIns
from wonderland_backend.db import migrate as migrations
from wonderland_backend.db.engine import Database
from wonderland_backend.db.roles import confine
from wonderland_backend.errors import BackendError
from wonderland_backend.http.times import now_ms
from wonderland_backend.listening import Loop
from wonderland_backend.mirror import rebuild as rebuilding
from wonderland_backend.mirror.rebuild import Digest
from wonderland_backend.people import links
from wonderland_backend.settings import Settings, load
from wonderland_fabric_gateway.errors import LedgerError

database_option = click.option(
    "--database", metavar="URL", help="sqlite:///file.db (the default: wonderland.db here) or postgresql://user@host/db"
)
json_option = click.option("--json", "as_json", is_flag=True, help="For machines.")


@click.command("link")
@database_option
@click.option("--name", help="Which administrator; not needed where there is only one.")
@click.option("--display", metavar="NAME", help="For a screen that nobody operates: it may look, nothing else.")
@json_option
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
            await require_tables(database)
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

    run_work(run, **options)


@click.command("migrate")
@database_option
@click.option("--server-role", metavar="ROLE", help="PostgreSQL: the role as which the server connects.")
@click.option(
    "--server-password-file",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Its password: the role is made where there is none.",
)
@json_option
def migrate_command(
    server_role: str | None, server_password_file: Path | None, *, as_json: bool, **options: Any
) -> None:
    """Bring the database's tables to this version. `serve` does it by itself, where it owns them.

    With --server-role the tables stay those of whoever migrates, and the server gets a role of its own that can append
    to the audit log and never change it: run this as the owner before each start of a new version.
    """
    if server_password_file is not None and server_role is None:
        raise click.UsageError("--server-password-file is the password of --server-role: give both")
    password = None if server_password_file is None else server_password_file.read_text().strip()

    async def run(settings: Settings) -> None:
        database = Database(settings.database)
        try:
            before = await migrations.revision(database)
            await migrations.migrate(database)
            after = await migrations.revision(database)
            if server_role is not None:
                await confine(database, server_role, password)
        finally:
            await database.close()
        if as_json:
            click.echo(json.dumps({"before": before, "after": after}))
        else:
            click.echo(f"The tables are at revision {after}" + (" already." if before == after else "."))

    run_work(run, **options)


@click.command("digest")
@database_option
@json_option
def digest_command(*, as_json: bool, **options: Any) -> None:
    """Print a digest of the tables that are derived from the ledger; equal content, equal digest."""

    async def run(settings: Settings) -> None:
        database = Database(settings.database)
        try:
            await require_tables(database)
            found = await rebuilding.digest(database)
        finally:
            await database.close()
        if as_json:
            click.echo(json.dumps(found.to_json()))
        else:
            print_digest(found)

    run_work(run, **options)


async def require_tables(database: Database) -> None:
    """Raises BackendError where the database is missing or of another version."""
    if not database.exists():
        raise BackendError(f"--database: there is no file {database.url.database}")
    if await migrations.revision(database) != migrations.head():
        raise BackendError("the database is of another version; run `wonderland backend migrate`")


def print_digest(found: Digest) -> None:
    """Rows and digest of each table, and of all."""
    width = max(map(len, found.tables))
    for name, each in found.tables.items():
        click.echo(f"{name:<{width}}  {each.rows:>9} rows  {each.sha256[:16]}")
    click.echo(f"{'all':<{width}}  {'':>9}       {found.sha256}")


def run_work(work: Callable[[Settings], Coroutine[Any, Any, None]], **options: Any) -> None:
    """Run with uvloop; an error that we raise on purpose is one line for people."""
    try:
        settings = load(**options)
        with asyncio.Runner(loop_factory=Loop) as runner:
            runner.run(work(settings))
    except (BackendError, LedgerError) as error:
        raise click.ClickException(str(error)) from error
    except OperationalError as error:  # a database server that is away, a file system that is full
        raise click.ClickException(f"the database cannot be used: {error.orig}") from error
