"""``wonderland evidence``: a session's evidence in one file, and its verification without a connection."""

from __future__ import annotations

import click

from wonderland.lazy_commands import LazyGroup


@click.group(
    cls=LazyGroup,
    lazy={
        "export": ("wonderland_evidence.export_commands:export", "Write a session's evidence; needs the ledger."),
        "trust": ("wonderland_evidence.export_commands:trust", "Write what a verifier pins; needs the ledger."),
        "statement": (
            "wonderland_evidence.statement_command:statement_command",
            "Check an answer that was signed.",
        ),
        "verify": ("wonderland_evidence.verify_command:verify_command", "Check a file, without a connection."),
    },
)
def evidence() -> None:
    """Evidence of a session in one file, which anybody can verify without us and without a connection.

    \b
      wonderland evidence trust  --connection connection.json --out trust.json
      wonderland evidence export --connection connection.json --session ID --out evidence.json
      wonderland evidence verify evidence.json --trust trust.json
    """  # noqa: D301 - \b is click's mark for "do not wrap"
