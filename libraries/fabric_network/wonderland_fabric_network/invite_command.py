"""``wonderland network invite | admit``: certificates for people and machines that make their keys themselves."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import click

from wonderland.enrolment import machine, officer
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded.organisations import ROLES
from wonderland_fabric_network import enrolment
from wonderland_fabric_network.console import dir_option, json_option, open_at


@click.command()
@click.argument("name")
@dir_option
@click.option("--role", required=True, type=click.Choice(tuple(ROLES)), help="What it may do (pol.role).")
@click.option("--id", "pol_id", default="", help="Registry id of the pad or drone (pol.id); the name unless given.")
@click.option("--org", "msp_id", help="The organisation, where several of its kind give out the role.")
@json_option
def invite(*, name: str, directory: Path, role: str, pol_id: str, msp_id: str | None, as_json: bool) -> None:
    """Print a one-time secret with which NAME enrols itself, with a key that never leaves its place.

    People enter it in the console, under Registry, Signing key.
    """
    made = open_at(directory)
    invited = asyncio.run(enrolment.invite(made, enrolment.Request(name, role, pol_id or name, msp_id)))
    if as_json:
        click.echo(json.dumps({"name": name, "msp_id": invited.msp_id, "role": role, "secret": invited.secret}))
        return
    click.echo(f"{name} of {invited.msp_id}, role {role}; good once:")
    click.echo(f"secret  {invited.secret}")


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@dir_option
@click.option("--org", "msp_id", help="The organisation, where several of its kind give out the role.")
@click.option("--yes", is_flag=True, help="Do not ask whether the code was compared.")
@click.option("--to", "target", type=click.Path(dir_okay=False, path_type=Path), help="Where the admission is written.")
def admit(*, file: Path, directory: Path, msp_id: str | None, yes: bool, target: Path | None) -> None:
    """Admit the machine of a request (`wonderland enrol request`): certificates for keys that never leave it.

    A name that was admitted before gets newer certificates. Nothing that is written is secret.
    """
    made = open_at(directory)
    asked = machine.read_request(file)
    home = enrolment.home_of(made, asked.role, msp_id)
    officer.show(asked, home, yes=yes)
    admitted = asyncio.run(enrolment.admit(made, asked, home))
    connection = Connection.load(made.directory.organisation(home).connection_file)
    admission = officer.admission_of(connection, asked, home, admitted.certificate, admitted.tls_certificate)
    officer.hand_over(admission, asked.name, target, file.parent)
