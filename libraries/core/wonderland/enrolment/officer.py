"""The side of who admits: what is shown, and the admission that a ledger's connection and two certificates make."""

from __future__ import annotations

import datetime as dt
from typing import TYPE_CHECKING

import click

from wonderland.enrolment.records import Admission, AuthorityPlace, EnrolmentRequest, Gateway, code
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.files import PUBLIC, write_atomic

if TYPE_CHECKING:
    from pathlib import Path


def show(request: EnrolmentRequest, msp_id: str, *, yes: bool) -> None:
    """What is asked for, and whether it is to be admitted; the end of the command where not."""
    made = dt.datetime.fromtimestamp(request.t_s, dt.UTC)
    click.echo(f"asks       {request.name}, made {made:%Y-%m-%d %H:%M} UTC")
    click.echo(f"would be   {request.role} {request.pol_id} of {msp_id}")
    click.echo(f"its code   {code(request.sha256)}")
    if not yes:
        click.confirm("Does the machine show the same code?", abort=True)


def admission_of(
    connection: Connection, request: EnrolmentRequest, msp_id: str, certificate: bytes, tls_certificate: bytes | None
) -> Admission:
    """What the machine is given. `connection` is its organisation's."""
    authority = connection.authorities.get(msp_id)
    place = None
    if authority is not None and authority.tls_ca_name:
        place = AuthorityPlace(
            address=authority.address,
            ca_name=authority.ca_name,
            tls_ca_name=authority.tls_ca_name,
            root=authority.tls_ca.read_text(),
        )
    return Admission(
        request_sha256=request.sha256,
        msp_id=msp_id,
        certificate=certificate.decode(),
        tls_certificate=None if tls_certificate is None else tls_certificate.decode(),
        channel=connection.channel,
        chaincode=connection.chaincode,
        gateways=tuple(
            Gateway(address=each.address, server_name=each.server_name)
            for each in (connection.gateway, *connection.others)
        ),
        tls_root=connection.gateway.tls_ca.read_text(),
        authority=place,
        ledger_kind=connection.ledger.kind if connection.ledger is not None else "fabric",
        notice=connection.ledger.notice if connection.ledger is not None else "",
    )


def hand_over(admission: Admission, name: str, target: Path | None, default: Path) -> None:
    """Write it, and say what is next."""
    file = target or default / f"{name}.admission"
    write_atomic(file, admission.encode() + b"\n", PUBLIC)
    click.echo(f"admission  {file}")
    click.echo(f"its code   {code(admission.sha256)}")
    click.echo("Give it to the machine: `wonderland enrol accept FILE` there. Nothing in it is secret.")
