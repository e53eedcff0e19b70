"""``wonderland backend``: the mirror, REST, live push and the console."""

from __future__ import annotations

import os
from pathlib import Path

import click

from wonderland.lazy_commands import LazyCommand, LazyGroup

_CONFIG = "WONDERLAND_BACKEND_CONFIG"
_WHERE = "wonderland_backend.backup.commands:"
backup = LazyCommand(f"{_WHERE}backup_command", "Copy the backend's database, and settings and keys, while it runs.")
restore = LazyCommand(f"{_WHERE}restore_command", "Bring back a backup, or try whether it can be.")


@click.group(
    cls=LazyGroup,
    lazy={
        "audit": ("wonderland_backend.server_commands:audit", "The audit log: who did or read what."),
        "client": ("wonderland_backend.clients.commands:client", "Register and revoke machines (OAuth 2.0 clients)."),
        "digest": (
            "wonderland_backend.database_commands:digest_command",
            "Print a digest of the tables derived from the ledger.",
        ),
        "health": ("wonderland_backend.deployment_commands:health_command", "Ask a running backend whether it serves."),
        "link": ("wonderland_backend.database_commands:link_command", "Print a one-time token that signs in."),
        "migrate": (
            "wonderland_backend.database_commands:migrate_command",
            "Bring the database's tables to this version.",
        ),
        "new-password": (
            "wonderland_backend.deployment_commands:new_password_command",
            "Make a password for the database, a token for /metrics.",
        ),
        "number": (
            "wonderland_backend.person_commands:number",
            "Registration numbers: openings out of this database and into another's.",
        ),
        "person": (
            "wonderland_backend.person_commands:person",
            "All that is kept about one drone or account: give it out, or erase it.",
        ),
        "openapi": (
            "wonderland_backend.server_commands:openapi_command",
            "Print the REST interface's description (OpenAPI 3.1).",
        ),
        "rebuild": (
            "wonderland_backend.server_commands:rebuild_command",
            "Read all blocks again into the derived tables.",
        ),
        "serve": ("wonderland_backend.server_commands:serve_command", "Serve until told to stop (SIGTERM, Ctrl-C)."),
    },
)
@click.option(
    "--config",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help=f"Settings (TOML); the environment and options win.  [{_CONFIG}]",
)
def backend(config: Path | None) -> None:
    """Mirror the ledger, take in what agents report, show both.

    The mirror reads the ledger's blocks into a database and checks their hash chain; nothing else writes verdicts.
    The console and machines read it by REST and a live WebSocket under /api/v1.
    """
    if config is not None:
        # Settings are read from the environment; that of this process says which file, too.
        os.environ[_CONFIG] = str(config)
