"""``wonderland evidence export`` and ``trust``: what is asked of a ledger."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Final, TypeVar

import click
from rich.console import Console

from wonderland_evidence import bundle as bundles
from wonderland_evidence import trust as trusts
from wonderland_evidence.errors import EvidenceError, UnreachedError, UnreadableError
from wonderland_evidence.export import export as export_session
from wonderland_evidence.export import trust as export_trust
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import FileWriteError, LedgerError
from wonderland_fabric_gateway.files import PUBLIC, write_atomic
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_gateway.gateway.client import Network

UNREACHED: Final = 5
READERS: Final = ("mirror", "inspector", "admin")
T = TypeVar("T")


class _UnreachedException(click.ClickException):
    """Nobody answered: an exit code of its own, for scripts."""

    exit_code = UNREACHED


_connection = click.option(
    "--connection",
    required=True,
    type=click.Path(exists=True, path_type=Path),
    help="connection.json of any ledger, or its directory.",
)
_identity = click.option(
    "--identity", default="", help="Who asks; without it the first of mirror, inspector, admin, or any."
)
_out = click.option("--out", required=True, type=click.Path(dir_okay=False, path_type=Path), help="The file to write.")


@click.command()
@_connection
@_identity
@click.option(
    "--session", "session_id", required=True, metavar="ID", help="The session's id: that of its RequestProof."
)
@click.option(
    "--timestamp",
    "timestamp_url",
    default="",
    metavar="URL",
    envvar="WONDERLAND_TIMESTAMP_URL",
    help="An RFC 3161 service to have the session's last block stamped by (extra timestamps).",
)
@_out
def export(*, connection: Path, identity: str, session_id: str, timestamp_url: str, out: Path) -> None:
    """Write a session's evidence; needs the ledger, and no backend.

    Exit code 1: the ledger has no such session, or refuses. 5: it could not be reached.
    """
    console = Console(stderr=True)
    with console.status("the ledger") as status:
        made = _ask(
            connection,
            identity,
            lambda network, chaincode: export_session(network, chaincode, session_id, status.update),
        )
        if timestamp_url:
            status.update("a time-stamp")
            made = _stamped(made, timestamp_url)
        data = made.encode()
    _write(out, data)
    whole = sum(each.data is not None for each in made.blocks)
    blocks = f"{whole} whole blocks and {len(made.blocks) - whole} neighbours"
    console.print(f"{out}: {len(data):,} bytes, {blocks}, {len(made.validity)} signed answers")


@click.command()
@_connection
@_identity
@click.option(
    "--timestamp-root",
    "timestamp_roots",
    multiple=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Root certificate (PEM) of a time-stamping service to pin; may be given several times.",
)
@_out
def trust(*, connection: Path, identity: str, timestamp_roots: tuple[Path, ...], out: Path) -> None:
    """Write what a verifier pins. Compare it by another way than the one it came by: it is where trust begins."""
    try:
        pems = [bundles.read_file(each, trusts.MAX_PEM) for each in timestamp_roots]
    except UnreadableError as cause:
        raise click.ClickException(str(cause)) from cause
    data = _ask(connection, identity, lambda network, _: export_trust(network, pems))
    _write(out, data)
    document = json.loads(data)
    click.echo(f"channel {document['channel']}, first block {document['genesis_hash']}", err=True)


def _ask(path: Path, identity: str, question: Callable[[Network, str], Awaitable[T]]) -> T:
    """Ask a ledger. Raises `ClickException` with what was wrong."""

    async def run() -> T:
        connection = Connection.load(path)
        there = connection.identities
        name = identity or next((each for each in (*READERS, *there) if each in there), "")
        async with connection.open_channel() as channel:
            gateway = Gateway(channel, connection.identity(name), connection.signer(name))
            return await question(gateway.network(connection.channel), connection.chaincode)

    try:
        return asyncio.run(run())
    except UnreachedError as cause:
        raise _UnreachedException(str(cause)) from cause
    except (LedgerError, EvidenceError) as cause:
        raise click.ClickException(str(cause)) from cause


def _stamped(made: bundles.Bundle, url: str) -> bundles.Bundle:
    try:
        from wonderland_evidence.stamping import with_timestamp  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as cause:
        raise click.ClickException(f"--timestamp needs wonderland-evidence[timestamps] ({cause})") from cause
    try:
        return asyncio.run(with_timestamp(made, url))
    except EvidenceError as cause:
        raise click.ClickException(str(cause)) from cause


def _write(path: Path, data: bytes) -> None:
    try:
        write_atomic(path, data, PUBLIC)
    except FileWriteError as cause:
        raise click.ClickException(str(cause)) from cause
