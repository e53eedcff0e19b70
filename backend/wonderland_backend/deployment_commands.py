"""What a deployment asks often or before anything else: whether the backend serves, and secrets. They import little."""

from __future__ import annotations

import secrets
import urllib.error
import urllib.request
from http import HTTPStatus
from pathlib import Path

import click

from wonderland_backend.db import passwords
from wonderland_backend.problem_texts import STANDBY, TYPE_BASE
from wonderland_fabric_gateway.errors import LedgerError

HEALTH_TIMEOUT_S = 5


@click.command("new-password")
@click.option(
    "--to",
    "directory",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Where to write it; what is there already stays.",
)
@click.option("--owner", default="wonderland", show_default=True, help="The role that owns the tables.")
@click.option("--server", default="wonderland_server", show_default=True, help="The role as which the server connects.")
def new_password_command(directory: Path, owner: str, server: str) -> None:
    """Make random passwords for the database's two roles, a token for /metrics, and a key for webhooks' secrets.

    DIR/owner/password is for PostgreSQL (its image takes it by POSTGRES_PASSWORD_FILE), DIR/owner/pgpass for
    `wonderland backend migrate` (--database 'postgresql://ROLE@HOST/NAME?passfile=DIR/owner/pgpass'). The same two in
    DIR/server are for the server's role; DIR/server/metrics-token is for Prometheus and, by
    WONDERLAND_BACKEND_METRICS_TOKEN_FILE, for this backend; DIR/server/webhook.key encrypts webhooks' secrets
    (WONDERLAND_BACKEND_WEBHOOK_KEY_FILE).
    """
    try:
        server_files = directory / "server"
        token = secrets.token_urlsafe(passwords.BYTES).encode() + b"\n"
        passwords.ensure_file(server_files / passwords.METRICS_TOKEN, token)
        passwords.ensure_file(server_files / passwords.WEBHOOK_KEY, passwords.new_key(secrets.token_bytes))
        made = [
            passwords.ensure(directory / name, role, secrets.token_urlsafe(passwords.BYTES))
            for name, role in (("owner", owner), ("server", server))
        ]
    except (LedgerError, OSError) as error:
        raise click.ClickException(f"{directory}: {error}") from error
    click.echo(f"{directory} has new passwords." if any(made) else f"{directory} has passwords already; they stay.")


@click.command("health")
@click.option("--at", "url", required=True, metavar="URL", help="The backend, for example http://127.0.0.1:8080")
def health_command(url: str) -> None:
    """Ask a running backend whether it serves, or stands by. Exit code 1 when it does neither."""
    if not url.startswith(("http://", "https://")):
        raise click.UsageError(f"--at: {url!r} is no address, for example http://127.0.0.1:8080")
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(f"{url.rstrip('/')}/api/v1/health", timeout=HEALTH_TIMEOUT_S) as answer:
            click.echo(answer.read(4096).decode(errors="replace"))
    except urllib.error.HTTPError as refusal:
        if refusal.code != HTTPStatus.SERVICE_UNAVAILABLE or TYPE_BASE + STANDBY not in (
            said := refusal.read(4096).decode()
        ):
            raise click.ClickException(f"the backend at {url} answers {refusal.code}; see its log") from None
        click.echo(said)
    except (OSError, ValueError) as error:
        raise click.ClickException(f"no backend answers at {url} ({error}); does it run?") from error
