"""``wonderland enrol``: a certificate for a machine whose key never leaves it."""

from __future__ import annotations

import asyncio
import datetime as dt
import os
from pathlib import Path
from typing import Any

import click

from wonderland.enrolment import machine, officer
from wonderland.enrolment.records import code
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.transactions import ROLES
from wonderland_fabric_gateway.ca.requests import CertificateRequest
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration
from wonderland_fabric_gateway.embedded.directory import LedgerDirectory
from wonderland_fabric_gateway.errors import LedgerError

_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
_dir = click.option(
    "--dir",
    "directory",
    default="identity",
    show_default=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Where this machine keeps its keys, certificates and connection.json.",
)


class _Group(click.Group):
    """Every error of its own ends as one line and exit code 1."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except (LedgerError, ProofError) as error:
            raise click.ClickException(str(error)) from error


@click.group(cls=_Group)
def enrol() -> None:
    """Get a certificate for a pad, a drone or a service, whose key never leaves its machine.

    \b
    On the machine, which prints a code:
      wonderland enrol request pad-7 --role pad --dir /etc/wonderland/pad
    By who runs the organisation's CA, comparing the code:
      wonderland network admit pad-7.request            on a Fabric network
      wonderland enrol admit pad-7.request --data DIR   on an embedded ledger
    On the machine again, and then by a timer:
      wonderland enrol accept pad-7.admission --dir /etc/wonderland/pad
      wonderland enrol renew --dir /etc/wonderland/pad
    """  # noqa: D301 - \b is click's mark for "do not wrap"


@enrol.command()
@click.argument("name")
@_dir
@click.option("--role", required=True, type=click.Choice(ROLES), help="What it would do.")
@click.option("--id", "pol_id", default="", help="Its id in the registry; the name unless given.")
@click.option("--key", type=_FILE, help="A key that is here already: a file, or one with a PKCS#11 URI (hardware).")
def request(*, name: str, directory: Path, role: str, pol_id: str, key: Path | None) -> None:
    """Make keys for NAME, which stay here, and a request for certificates."""
    place = machine.Place(directory)
    made = machine.make_request(
        place, name, role, pol_id or name, key=key, now=dt.datetime.now(dt.UTC), random_bytes=os.urandom
    )
    click.echo(f"request    {place.request(name)}")
    click.echo(f"its code   {code(made.sha256)}")
    click.echo("Give it to who runs the CA of your organisation, and tell the code. Nothing in it is secret.")


@enrol.command()
@click.argument("file", type=_FILE)
@click.option("--data", required=True, type=click.Path(file_okay=False, path_type=Path), help="The embedded ledger's.")
@click.option("--org", "msp_id", help="The organisation, where several give out the role.")
@click.option("--yes", is_flag=True, help="Do not ask whether the code was compared.")
@click.option("--to", "target", type=click.Path(dir_okay=False, path_type=Path), help="Where the admission is written.")
def admit(*, file: Path, data: Path, msp_id: str | None, yes: bool, target: Path | None) -> None:
    """Admit the machine of a request on an embedded ledger; one that was admitted before gets a newer certificate."""
    asked = machine.read_request(file)
    directory = LedgerDirectory(data)
    administration = DirectoryAdministration(directory)
    home = administration.home_of(asked.name, asked.role, msp_id)
    officer.show(asked, home, yes=yes)
    certificate = administration.admit(
        CertificateRequest.parse(asked.request), role=asked.role, pol_id=asked.pol_id, msp_id=home
    )
    connection = Connection.load(directory.connection_file)
    admission = officer.admission_of(connection, asked, home, certificate, None)
    officer.hand_over(admission, asked.name, target, file.parent)


@enrol.command()
@click.argument("file", type=_FILE)
@_dir
@click.option("--yes", is_flag=True, help="Do not ask whether the code was compared.")
def accept(*, file: Path, directory: Path, yes: bool) -> None:
    """Take an admission: certificates for the keys that are here, and how the ledger is reached."""
    admission = machine.read_admission(file)
    click.echo(f"of         {admission.msp_id}, channel {admission.channel}, by {admission.gateways[0].address}")
    click.echo(f"its code   {code(admission.sha256)}")
    if not yes:
        click.confirm("Did who admitted it read you the same?", abort=True)
    place = machine.Place(directory)
    name = machine.accept(place, admission)
    click.echo(f"identity   {name}")
    click.echo(f"connection {place.connection}")


@enrol.command()
@_dir
@click.option("--identity", help="Which of connection.json's; the only one unless given.")
@click.option("--days", default=30, show_default=True, type=click.IntRange(0, 3_650), help="What ends within so many.")
def renew(*, directory: Path, identity: str | None, days: int) -> None:
    """Renew what ends soon, by the organisation's CA, with the keys that are here. For a daily timer."""
    connection = Connection.load(directory)
    if identity is None and len(connection.identities) != 1:
        raise click.UsageError(f"say which with --identity: {', '.join(sorted(connection.identities))}")
    name = identity or next(iter(connection.identities))
    done = asyncio.run(machine.renew(connection, name, within=dt.timedelta(days=days), now=dt.datetime.now(dt.UTC)))
    for each in done:
        click.echo(f"renewed    {each}")
    if not done:
        click.echo(f"nothing ends within {days} days")
