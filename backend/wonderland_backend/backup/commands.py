"""``wonderland backup`` and ``wonderland restore``."""

from __future__ import annotations

import json
import os
import secrets
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import click
import psycopg
from sqlalchemy.engine import URL

from wonderland_backend import audit
from wonderland_backend.backup import make, manifest, restoring, sealed, taken
from wonderland_backend.database_commands import database_option, json_option, require_tables, run_work
from wonderland_backend.db import migrate
from wonderland_backend.db.engine import Database
from wonderland_backend.db.roles import confine
from wonderland_backend.http.times import now_ms
from wonderland_backend.leader_election.lock import held
from wonderland_backend.personal_data import store
from wonderland_backend.personal_data.subjects import Erased, journal
from wonderland_backend.settings import CONFIG, Settings
from wonderland_backend.webhooks import sealing
from wonderland_fabric_gateway.errors import LedgerError

PACKAGED: Final = Path("/etc/wonderland/backend.toml")
_file = click.Path(exists=True, dir_okay=False, path_type=Path)
config_option = click.option(
    "--config", type=_file, help=f"The backend's settings; {PACKAGED}, where it is there.  [{CONFIG}]"
)
passphrase_option = click.option(
    "--passphrase-file", type=_file, help="Its first line: the passphrase of settings and keys."
)


@click.command("backup")
@click.option("--to", required=True, type=click.Path(file_okay=False, path_type=Path), help="Where backups are kept.")
@click.option("--keep", type=click.IntRange(1, 100_000), help="The oldest beyond so many are removed.  [all stay]")
@passphrase_option
@click.option(
    "--also",
    multiple=True,
    type=click.Path(exists=True, path_type=Path),
    help="A file or directory more, for example an embedded ledger's; needs the passphrase.",
)
@config_option
@database_option
@json_option
def backup_command(
    to: Path, keep: int | None, passphrase_file: Path | None, also: tuple[Path, ...], config: Path | None, *,
    as_json: bool, **options: Any,
) -> None:  # fmt: skip
    """Copy the backend's database while it runs: registration numbers, accounts, audit log, what agents reported.

    Makes a directory in --to with a manifest of SHA-256. With --passphrase-file the settings come along, with every key
    and certificate that they name, encrypted; the database is not, so guard the directory as you guard the database.
    """
    if also and passphrase_file is None:
        raise click.UsageError("--also needs --passphrase-file: what is beside the database may be keys")
    chosen = _choose(config)
    passphrase: list[bytes] = []

    async def run(settings: Settings) -> None:
        if passphrase_file is not None:
            passphrase.append(sealed.passphrase_in(passphrase_file))
        database = Database(settings.database)
        try:
            await require_tables(database)
        finally:
            await database.close()
        revision = migrate.head()
        assert revision is not None
        beside = [] if passphrase_file is None else [*sealed.named_files(settings), *_webhook_keys(database.url), *also]
        if beside and chosen is not None:
            beside.append(chosen)
        made = make.make(
            database.url, revision, to, now_ms(), keep=keep, also=beside,
            passphrase=passphrase[0] if passphrase else None, randomness=secrets.token_bytes,
        )  # fmt: skip
        if as_json:
            click.echo(json.dumps({"backup": str(made)}))
        else:
            click.echo(f"{made} is whole." + ("" if passphrase else " Settings and keys are not in it."))

    _run(run, "nothing is left of it", **options)


@click.command("restore")
@click.argument("backup", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--verify", is_flag=True, help="Only try it: into a database of its own, compared and dropped.")
@click.option("--replace", is_flag=True, help="In the place of what is in the database.")
@click.option("--journal", "journal_file", type=_file, help="Erasures; those since the backup are done again.")
@click.option("--server-role", metavar="ROLE", help="PostgreSQL: as which the server connects.  [as in the backup]")
@click.option("--server-password-file", type=_file, help="Its password: the role is made where there is none.")
@click.option(
    "--files-to",
    type=click.Path(file_okay=False, path_type=Path),
    help="Only settings, keys and further files, below this directory.",
)
@passphrase_option
@config_option
@database_option
def restore_command(
    backup: Path, journal_file: Path | None, server_role: str | None, server_password_file: Path | None,
    files_to: Path | None, passphrase_file: Path | None, config: Path | None, *, verify: bool, replace: bool,
    **options: Any,
) -> None:  # fmt: skip
    """Bring back what `wonderland backup` made: all of it, or nothing is changed.

    On PostgreSQL as the role that owns the database, with the backend stopped.
    """
    if (files_to is None) != (passphrase_file is None):
        raise click.UsageError("--files-to and --passphrase-file go together")
    _choose(config)
    try:
        noted = b"" if journal_file is None else journal_file.read_bytes()
        password = None if server_password_file is None else server_password_file.read_text().strip()
    except (OSError, UnicodeDecodeError) as error:
        raise click.ClickException(str(error)) from error

    async def run(settings: Settings) -> None:
        found = manifest.read(backup)
        if files_to is not None and passphrase_file is not None:
            done = restoring.files(found, backup, files_to, sealed.passphrase_in(passphrase_file))
            click.echo("".join(f"{each}\n" for each in done) + f"{len(done)} files are there again.")
            return
        database = Database(settings.database)
        try:
            restoring.refuse_unknown(found, database.url)
            if verify:
                restoring.verify(found, backup, database.url, f"wonderland_verify_{secrets.token_hex(4)}")
                click.echo(f"{backup} is whole, and what was restored of it is what was backed up.")
                return
            await _restore(database, settings, found)
        finally:
            await database.close()

    async def _restore(database: Database, settings: Settings, found: manifest.Manifest) -> None:
        role = server_role or found.server_role or None
        again = journal(noted)
        must_exist = role if password is None else None
        async with held(settings.database):
            replacing = restoring.database(found, backup, database.url, replace=replace, role=must_exist, journal=again)
            with replacing as before:
                try:
                    await migrate.migrate(database)
                    if role is not None:
                        await confine(database, role, password)
                    async with database.write() as connection:
                        rows = await taken.take_again(connection, before, now_ms())
                        detail = {"made_ms": found.made_ms}
                        await audit.record(
                            connection, store.SERVER, "restore_database", backup.name, detail, t_ms=now_ms()
                        )
                    rows += await _erase(database, restoring.since(found, again))
                finally:
                    # Where something failed, what was there is put back: no connection may be in its way.
                    await database.close()
        moment = f"{datetime.fromtimestamp(found.made_ms / 1000, UTC):%Y-%m-%d %H:%M:%S} UTC"
        click.echo(f"The database is as it was at {moment}.")
        for line in rows:
            click.echo(line)
        if journal_file is None:
            click.echo(
                "What was erased since then is there again: wonderland backend person erase-again --journal FILE --yes"
            )

    _run(run, "what was there is as it was", **options)


def _webhook_keys(url: URL) -> list[Path]:
    """Without them the webhooks in the database cannot be signed."""
    path = sealing.beside(url)
    return [path] if path is not None and path.is_file() else []


async def _erase(database: Database, again: list[Erased]) -> list[str]:
    said = []
    for each in again:
        async with database.write() as connection:
            found = await store.erase(connection, each, store.AGAIN, now_ms(), dry=False, again=True)
        said.append(f"Erased again: {each.subject.audited}: {sum(found.values())} rows")
    return said


def _choose(config: Path | None) -> Path | None:
    """The settings' file, for whoever reads them next."""
    named = os.environ.get(CONFIG)
    chosen = config or (Path(named) if named else PACKAGED if PACKAGED.is_file() else None)
    if chosen is not None:
        os.environ[CONFIG] = str(chosen)
    return chosen


def _run(work: Any, after: str, **options: Any) -> None:
    try:
        run_work(work, **options)
    except (OSError, LedgerError, psycopg.Error) as error:
        raise click.ClickException(f"{error}; {after}") from error
