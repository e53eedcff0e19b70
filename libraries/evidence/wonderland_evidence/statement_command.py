"""``wonderland evidence statement``: what a server said, if it did."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

import click

from wonderland_evidence import bundle as bundles
from wonderland_evidence import statements
from wonderland_evidence import trust as trusts
from wonderland_evidence.errors import StatementError, UnreadableError
from wonderland_evidence.verify_command import FAILED, UNREADABLE


@click.command(name="statement")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--trust", "trust_file", required=True, type=click.Path(path_type=Path), help="The pinned facts.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def statement_command(*, file: Path, trust_file: Path, as_json: bool) -> None:
    """Check an answer that a server signed (Accept: application/jose), without a connection.

    It proves that this organisation's server said this, then; what the ledger says is proved by `wonderland evidence
    verify`. Exit code 0: it holds. 1: it does not. 3: it cannot be read.
    """
    try:
        pins = trusts.Pins.decode(bundles.read_file(trust_file, trusts.MAX_BYTES))
        found = statements.verify_statement(
            bundles.read_file(file, statements.MAX_BYTES).decode("ascii", "replace"), pins
        )
    except (UnreadableError, StatementError) as cause:
        unreadable = isinstance(cause, UnreadableError)
        code = cause.code if isinstance(cause, UnreadableError) else "does_not_hold"
        click.echo(json.dumps({"code": code, "text": str(cause)}) if as_json else f"{file}: {cause}", err=not as_json)
        sys.exit(UNREADABLE if unreadable else FAILED)
    if as_json:
        click.echo(json.dumps(asdict(found), ensure_ascii=False))
        return
    when = datetime.fromtimestamp(found.issued_s, UTC).isoformat()
    click.echo(f"{found.common_name} of {found.msp_id} said at {when}, of channel {found.channel} ({found.about}):")
    click.echo(json.dumps(found.content, indent=2, ensure_ascii=False))
    click.echo("Not checked: whether the certificate was revoked, and what the ledger says.")
