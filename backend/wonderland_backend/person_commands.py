"""``wonderland backend person …`` and ``number …``: what somebody may ask for by law, and openings that move."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click
import orjson

from wonderland.proofs.errors import ProofError
from wonderland.proofs.registration import Opening
from wonderland_backend import audit
from wonderland_backend.database_commands import database_option, json_option, require_tables, run_work
from wonderland_backend.db.engine import Database
from wonderland_backend.errors import BackendError
from wonderland_backend.http.times import now_ms
from wonderland_backend.numbers import store as numbers
from wonderland_backend.people import store as people
from wonderland_backend.people.schemas import PersonChange
from wonderland_backend.personal_data import queries, store
from wonderland_backend.personal_data.store import AGAIN, SERVER, STAYS
from wonderland_backend.personal_data.subjects import Erased, Subject, journal
from wonderland_backend.settings import Settings
from wonderland_fabric_gateway.files import write_atomic

MAX_BYTES = 4096
_drone = click.option("--drone", metavar="SERIAL", help="A drone and its operator, by serial number.")
_account = click.option("--account", metavar="ID", help="Somebody who signs in, by person_id (GET /api/v1/people).")
_reason = click.option("--reason", required=True, metavar="TEXT", help="For the audit log; names nobody.")
_out = click.option(
    "--out",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="A new file, for you alone.",
)
_journal_help = "Keep it outside of the database and of its backups: it says what to erase again after a restore."


@click.group()
def person() -> None:
    """Accounts without the console; access and erasure of what is kept about a drone's operator or an account."""


@click.group()
def number() -> None:
    """Openings of registration numbers: out of this database and into another's."""


@person.command("list")
@database_option
@json_option
def list_(*, as_json: bool, **options: Any) -> None:
    """Who may sign in, and as what: to look through after a restore, before others use it."""

    async def work(database: Database) -> None:
        async with database.read() as session:
            found = await people.listing(session)
        if as_json:
            click.echo(json.dumps(found))
            return
        for each in found:
            roles = " ".join(each["roles"])
            click.echo(f"{each['person_id']}  {each['state']:<9}  {roles:<24}  {each['name']}")

    _run(work, **options)


@person.command("suspend")
@click.option("--account", required=True, metavar="ID", help="By person_id (`person list`).")
@_reason
@database_option
def suspend(account: str, reason: str, **options: Any) -> None:
    """End somebody's sign-ins, and let them in no more. An administrator restores the account in the console."""

    async def work(database: Database) -> None:
        async with database.write() as connection:
            before = await people.find_person(connection, account)
            if before["state"] == people.SUSPENDED:
                raise BackendError(f"{before['name']} is suspended already")
            wanted = PersonChange(revision=before["revision"], state="suspended")
            await people.change(connection, SERVER, account, wanted, now_ms(), reason=reason)
        click.echo(f"{before['name']} is suspended. A backend that runs ends their sign-ins at their next request.")

    _run(work, **options)


@person.command("access")
@_drone
@_account
@_reason
@_out
@database_option
def access(drone: str | None, account: str | None, reason: str, out: Path, **options: Any) -> None:
    """Write everything about one of them to a zip: one file of JSON lines for each table. Audited."""
    subject = _subject(drone, account)

    async def work(database: Database) -> None:
        counts: dict[str, int] = {}
        with _private(out) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
            async with database.read() as session:
                if not await queries.is_known(session, subject):
                    raise BackendError(f"nothing is kept about {subject.audited}")
                for table, condition in queries.parts(subject):
                    with packed.open(f"{table.name}.jsonl", "w") as lines:
                        async for row in queries.rows(session, table, condition):
                            lines.write(orjson.dumps(row, option=orjson.OPT_APPEND_NEWLINE))
                            counts[str(table.name)] = counts.get(table.name, 0) + 1
            about = {"about": subject.audited, "made_ms": now_ms(), "rows": counts, "besides": STAYS[subject.kind]}
            packed.writestr("about.json", orjson.dumps(about, option=orjson.OPT_INDENT_2))
        async with database.write() as connection:
            detail = {"reason": reason, "rows": sum(counts.values())}
            await audit.record(connection, SERVER, "give_personal_data", subject.audited, detail, t_ms=now_ms())
        click.echo(f"{sum(counts.values())} rows of {len(counts)} tables are in {out}; it is personal data.")

    _run(work, **options)


@person.command("erase")
@_drone
@_account
@_reason
@click.option("--journal", "path", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help=_journal_help)
@click.option("--yes", is_flag=True, help="Erase. Without it nothing is changed: it is said what would be.")
@database_option
@json_option
def erase(
    drone: str | None, account: str | None, reason: str, path: Path | None, *, yes: bool, as_json: bool, **options: Any
) -> None:
    """Erase what no proof rests on: a drone's number, salt, positions; an account's name, address, passkeys, sign-ins.

    What stays is said with its reason. Proofs can be checked as before. Backups made before have it still: after a
    restore run `erase-again`.
    """
    subject = _subject(drone, account)
    if yes and path is None:
        raise click.UsageError("--yes needs --journal FILE, or a restored backup brings back what was erased")

    async def work(database: Database) -> None:
        async with database.read() as session:
            if not await queries.is_known(session, subject):
                raise BackendError(f"nothing is kept about {subject.audited}")
            commitments = await queries.commitments_of(session, subject.id) if subject.kind == "drone" else ()
        erased = Erased(subject, now_ms(), commitments)
        async with database.write() as connection:
            found = await store.erase(connection, erased, reason, erased.erased_ms, dry=not yes)
            if yes and path is not None:
                _note(path, erased)  # before the commit: one line too many does no harm, one too few does
        if as_json:
            click.echo(json.dumps({"erased": yes, "rows": found, "stays": STAYS[subject.kind]}))
            return
        _say(found, subject, yes=yes)

    _run(work, **options)


@person.command("erase-again")
@click.option(
    "--journal",
    "path",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="What `erase --journal` kept.",
)
@click.option("--yes", is_flag=True, help="Erase. Without it nothing is changed.")
@database_option
def erase_again(path: Path, *, yes: bool, **options: Any) -> None:
    """After a restore: erase once more all that the journal names. What is newer than each erasure stays."""
    noted = path.read_bytes()

    async def work(database: Database) -> None:
        total = 0
        for erased in journal(noted):
            async with database.write() as connection:
                found = await store.erase(connection, erased, AGAIN, now_ms(), dry=not yes, again=True)
            rows = sum(found.values())
            total += rows
            click.echo(f"{erased.subject.audited}: {rows} rows")
        click.echo(f"{total} rows are erased." if yes else f"{total} rows would be erased: add --yes.")

    _run(work, **options)


@number.command("export")
@click.argument("uav_id")
@_reason
@_out
@database_option
def export(uav_id: str, reason: str, out: Path, **options: Any) -> None:
    """Write the opening of a drone's number to a file whose SHA-256 is the ledger's commitment. Audited."""

    async def work(database: Database) -> None:
        async with database.write() as connection:
            found = await numbers.number_of(connection, uav_id)
            if found is None or found.opening is None:
                raise BackendError(_missing(uav_id, found))
            await audit.record(connection, SERVER, "give_number", f"drone/{uav_id}", {"reason": reason}, t_ms=now_ms())
            write_atomic(out, found.opening.encode())
        click.echo(f"{out} opens {found.opening.commitment}: whoever has it knows the number.")

    _run(work, **options)


@number.command("import")
@click.argument("files", nargs=-1, required=True, type=click.Path(exists=True, dir_okay=False, path_type=Path))
@database_option
def import_(files: tuple[Path, ...], **options: Any) -> None:
    """Take openings in, of drones whose record on the ledger they open. One that does not: none is taken."""
    openings = [_read(path) for path in files]

    async def work(database: Database) -> None:
        async with database.write() as connection:
            for path, opening in openings:
                committed = await numbers.commitment_of(connection, opening.uav_id)
                if committed != opening.commitment:
                    raise BackendError(
                        f"{path}: does not open what the ledger has of {opening.uav_id}"
                        + ("" if committed else ", which is no commitment, or no such drone is mirrored here")
                    )
                await numbers.replace(connection, opening, SERVER, now_ms())
                subject = f"drone/{opening.uav_id}"
                await audit.record(connection, SERVER, "take_number", subject, t_ms=now_ms())
        click.echo(f"{len(openings)} taken in.")

    _run(work, **options)


def _subject(drone: str | None, account: str | None) -> Subject:
    if (drone is None) == (account is None):
        raise click.UsageError("give --drone or --account")
    return Subject("drone", drone) if drone is not None else Subject("account", account or "")


def _missing(uav_id: str, found: numbers.Number | None) -> str:
    if found is None:
        return f"no drone {uav_id} is mirrored here"
    return {
        "none": f"{uav_id} was registered without a number",
        "elsewhere": f"nothing here opens the commitment of {uav_id}; {found.msp_id} registered it",
    }.get(found.state, f"what is kept for {uav_id} does not open its commitment: somebody has changed it")


def _read(path: Path) -> tuple[Path, Opening]:
    try:
        with path.open("rb") as file:
            return path, Opening.decode(file.read(MAX_BYTES))
    except (ProofError, OSError) as error:
        raise click.ClickException(f"{path}: {error}") from error


def _note(path: Path, erased: Erased) -> None:
    with open(path, "ab", opener=_private_file) as file:
        file.write(erased.line())
        file.flush()
        os.fsync(file.fileno())


def _private(path: Path) -> Any:
    return open(path, "xb", opener=_private_file)


def _private_file(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_CLOEXEC, 0o600)


def _say(found: dict[str, int], subject: Subject, *, yes: bool) -> None:
    for name, rows in found.items():
        click.echo(f"{name:<22} {rows:>9}")
    click.echo("Erased. It stays:" if yes else "Nothing is erased yet: add --yes. It would stay:")
    _lines(STAYS[subject.kind])


def _lines(texts: Iterable[str]) -> None:
    for each in texts:
        click.echo(f"- {each}")


def _run(work: Any, **options: Any) -> None:
    async def run(settings: Settings) -> None:
        database = Database(settings.database)
        try:
            await require_tables(database)
            await work(database)
        finally:
            await database.close()

    try:
        run_work(run, **options)
    except OSError as error:
        raise click.ClickException(str(error)) from error
