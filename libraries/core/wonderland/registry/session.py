"""What every command of the registry shares: the ledger by an identity, progress, tables for people and machines."""

from __future__ import annotations

import asyncio
import contextlib
import csv
import functools
import json
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

import click
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from rich.text import Text

from wonderland.consoles import for_people
from wonderland.proof_contract import AwayError, ProofContract
from wonderland.registry.book import Book, read_book
from wonderland.registry.changes import OpeningsError
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_gateway.identity import Identity

FORMATS: Final = ("table", "csv", "json")
_Function = TypeVar("_Function", bound=Callable[..., Any])
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Ledger:
    """Which ledger, and as whom."""

    connection: Path
    identity: str

    def run(self, work: Callable[[ProofContract], Awaitable[_Result]]) -> _Result:
        """With the contract as that identity; what goes wrong ends the command with a line."""

        async def running() -> _Result:
            async with self._open() as contract:
                return await work(contract)

        try:
            return asyncio.run(running())
        except AwayError as error:
            sent = f" Transaction {error.tx_id} may yet be committed: look before you try again." if error.tx_id else ""
            raise click.ClickException(f"{error}.{sent}") from error
        except (LedgerError, OpeningsError) as error:
            raise click.ClickException(str(error)) from error

    def who(self) -> Identity:
        """Who that is, by its certificate."""
        try:
            return Connection.load(self.connection).identity(self.identity)
        except LedgerError as error:
            raise click.ClickException(str(error)) from error

    @contextlib.asynccontextmanager
    async def _open(self) -> AsyncIterator[ProofContract]:
        where = Connection.load(self.connection)
        who = where.identity(self.identity)
        async with where.open_channel() as channel:
            network = Gateway(channel, who, where.signer(self.identity)).network(where.channel)
            yield ProofContract(network, where.chaincode)


def of_a_ledger(function: _Function) -> _Function:
    """``--connection`` and ``--identity``, given to the command as ``ledger``."""

    @click.option(
        "--connection",
        required=True,
        envvar="WONDERLAND_CONNECTION",
        type=click.Path(path_type=Path),
        help="connection.json of the ledger; WONDERLAND_CONNECTION unless given.",
    )
    @click.option(
        "--identity",
        required=True,
        envvar="WONDERLAND_IDENTITY",
        metavar="NAME",
        help="Who signs: a name in connection.json; WONDERLAND_IDENTITY unless given.",
    )
    @functools.wraps(function)
    def command(*, connection: Path, identity: str, **more: Any) -> Any:
        return function(ledger=Ledger(connection, identity), **more)

    return command  # type: ignore[return-value]


def as_format(function: _Function) -> _Function:
    """``--format``."""
    option = click.option(
        "--format",
        "as_format",
        type=click.Choice(FORMATS),
        default="table",
        show_default=True,
        help="How it is printed.",
    )
    return option(function)


async def book_of(contract: ProofContract) -> Book:
    """Read the ledger's blocks; on a terminal with progress."""
    with progress() as shown:
        task = shown.add_task("Reading the ledger", total=None)
        return await read_book(contract, lambda block, height: shown.update(task, completed=block, total=height))


def progress() -> Progress:
    """On the terminal only, and gone when it is done."""
    console = Console(stderr=True)
    return Progress(console=console, transient=True, disable=not console.is_terminal)


def show(rows: Sequence[Mapping[str, str]], columns: Sequence[str], as_format: str) -> None:
    """Rows, all with these columns, on standard output."""
    if as_format == "json":
        click.echo(json.dumps(list(rows), ensure_ascii=False, indent=2))
    elif as_format == "csv":
        writer = csv.DictWriter(sys.stdout, list(columns), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    else:
        console = for_people()
        table = Table(*columns, box=None, pad_edge=False, highlight=False)
        for row in rows:
            # Names are anybody's: what looks like markup is none, and control characters stay out of the terminal.
            table.add_row(*(Text(_printable(row[name])) for name in columns))
        console.print(table, crop=False, overflow="fold", no_wrap=not console.is_terminal)


def _printable(text: str) -> str:
    return "".join(letter if letter.isprintable() else "\ufffd" for letter in text)


def show_record(document: Mapping[str, Any]) -> None:
    """A record as the ledger has it."""
    click.echo(json.dumps(document, ensure_ascii=False, indent=2, sort_keys=True))
