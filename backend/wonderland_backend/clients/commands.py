"""``wonderland backend client …``: machines that may read the API."""

from __future__ import annotations

import asyncio
import json
import secrets
import time
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

import click

from wonderland_backend.clients import store
from wonderland_backend.clients.schemas import NewCertificate
from wonderland_backend.clients.scopes import PROOFS, SCOPES
from wonderland_backend.clients.store import ByCertificate, ClientError, Clients, NewClient
from wonderland_backend.db import migrate as migrations
from wonderland_backend.db.engine import Database
from wonderland_backend.errors import BackendError, Problem
from wonderland_backend.settings import load

_SERVER: Final = "the server's administrator"
_database = click.option(
    "--database", metavar="URL", help="sqlite:///file.db (the default: wonderland.db here) or postgresql://user@host/db"
)
_json = click.option("--json", "as_json", is_flag=True, help="For machines.")
Result = TypeVar("Result")


@click.group()
def client() -> None:
    """Register and revoke machines (OAuth 2.0 clients) that may read the API."""


@client.command("add")
@click.argument("name")
@click.option(
    "--scope",
    "scopes",
    multiple=True,
    type=click.Choice(list(SCOPES)),
    default=(PROOFS,),
    show_default=True,
    help="What it may do; several times.",
)
@click.option("--role", type=click.Choice(store.ROLES), default="viewer", show_default=True, help="What it sees.")
@click.option("--msp-id", default="", help="Of which organisation, for pad_operator and fleet_operator.")
@click.option(
    "--jwks",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Its public keys (JWKS), if it signs assertions instead of having a secret.",
)
@click.option(
    "--certificate",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Its own TLS certificate (PEM), if it authenticates by that.",
)
@click.option("--subject-dn", metavar="DN", help="Any certificate of the client CAs with this subject (RFC 4514).")
@click.option("--san-dns", metavar="NAME", help="Any certificate of the client CAs for this DNS name.")
@click.option("--san-uri", metavar="URI", help="Any certificate of the client CAs for this URI.")
@_database
@_json
def add(
    name: str,
    scopes: tuple[str, ...],
    role: Any,
    msp_id: str,
    jwks: Path | None,
    certificate: Path | None,
    database: str | None,
    *,
    as_json: bool,
    **names: str | None,
) -> None:
    """Register the machine NAME. Its secret is printed this once."""
    tls = _certificate(certificate, names)
    try:
        keys = json.loads(jwks.read_text()) if jwks is not None else None
    except (OSError, ValueError) as error:
        raise click.ClickException(f"--jwks: {jwks} cannot be read as JSON ({error})") from error

    async def work(clients: Clients, opened: Database) -> tuple[str, str | None]:
        async with opened.write() as connection:
            row, secret = await clients.add(connection, NewClient(name, scopes, role, msp_id, keys, tls), _SERVER)
        return row.client_id, secret

    client_id, secret = _run(work, database)
    if as_json:
        click.echo(json.dumps({"client_id": client_id, "client_secret": secret}))
        return
    click.echo(f"client id:      {client_id}")
    own = "It signs with its own key." if tls is None else "It authenticates by its certificate."
    click.echo(f"client secret:  {secret}" if secret is not None else own)


def _certificate(path: Path | None, names: Mapping[str, str | None]) -> ByCertificate | None:
    try:
        given = NewCertificate(pem=None if path is None else path.read_text(), **names)
        return given.known_by() if any(given.model_dump().values()) else None
    except (ClientError, OSError, ValueError) as error:
        raise click.ClickException(f"--certificate, --subject-dn, --san-dns, --san-uri: {error}") from error


@client.command("list")
@_database
@_json
def list_command(database: str | None, *, as_json: bool) -> None:
    """Show all machines, revoked ones included."""

    async def work(_: Clients, opened: Database) -> list[dict[str, Any]]:
        async with opened.read() as session:
            return [store.client_json(row) for row in await store.listing(session, limit=10_000)]

    found = _run(work, database)
    if as_json:
        click.echo(json.dumps(found))
        return
    for each in found:
        state = "revoked" if "revoked_ms" in each else each["role"]
        click.echo(f"{each['client_id']}  {state:<14}  {each['name']}  ({' '.join(each['scopes'])})")


@client.command("revoke")
@click.argument("client_id")
@_database
def revoke(client_id: str, database: str | None) -> None:
    """Revoke a machine for good; its tokens are worth nothing from now on."""

    async def work(clients: Clients, opened: Database) -> None:
        async with opened.write() as connection:
            await clients.revoke(connection, client_id, _SERVER)

    _run(work, database)
    click.echo(f"{client_id} is revoked.")


def _run(work: Callable[[Clients, Database], Awaitable[Result]], address: str | None) -> Result:
    async def run() -> Result:
        database = Database(load(database=address).database)
        try:
            if not database.exists() or await migrations.revision(database) != migrations.head():
                url = database.url.set(drivername=database.url.get_backend_name()).render_as_string()
                raise BackendError(
                    f"there is no database of this version at {url}; name the server's own with "
                    "--database (a new one is made by `wonderland backend migrate`)"
                )
            return await work(Clients(database, lambda: time.time_ns() // 1_000_000, secrets.token_bytes), database)
        finally:
            await database.close()

    try:
        return asyncio.run(run())
    except Problem as error:
        raise click.ClickException(str(error)) from error
    except (BackendError, OSError, ValueError) as error:
        raise click.ClickException(str(error)) from error
