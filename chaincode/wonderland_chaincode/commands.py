"""``wonderland chaincode``: run the contract as a service for the peers of a Hyperledger Fabric network."""

from __future__ import annotations

import asyncio
import json
import logging
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wonderland_chaincode.service import logs
from wonderland_chaincode.service.errors import SettingsError
from wonderland_chaincode.service.metrics import Metrics
from wonderland_chaincode.service.operations import Operations
from wonderland_chaincode.service.server import ContractServer
from wonderland_chaincode.service.settings import Limits, check_listen, check_package_id
from wonderland_chaincode.service.tls import Tls
from wonderland_fabric_gateway.embedded.contracts import load_contract
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.files import read_bounded

if TYPE_CHECKING:
    from collections.abc import Callable

_log = logging.getLogger(__name__)
_file = click.Path(dir_okay=False, path_type=Path)


class _Group(click.Group):
    """Every error of the service's own ends as one line and exit code 1, never as a stack trace."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except LedgerError as error:
            raise click.ClickException(str(error)) from error


@click.group(cls=_Group)
def chaincode() -> None:
    """Run the contract as a service for the peers of a Hyperledger Fabric network.

    \b
    Each organisation that endorses runs its own; its peers dial it (chaincode as a service).
      wonderland chaincode serve --package-id pol_1.0:3f1c… --listen 127.0.0.1:9999
      wonderland chaincode health --at 127.0.0.1:9998

    `wonderland network up` starts one for each organisation of its network. The embedded ledger needs none: it runs
    the same contract in place.
    """  # noqa: D301 - \b is click's mark for "do not wrap"


@chaincode.command()
@click.option("--package-id", envvar="CHAINCODE_ID", metavar="LABEL:HASH", help="As installing it said.")
@click.option("--package-id-file", type=_file, help="A file with it, as `wonderland network certify` writes one.")
@click.option(
    "--listen", envvar="CHAINCODE_SERVER_ADDRESS", required=True, metavar="HOST:PORT", help="0 takes a free port."
)
@click.option("--contract", "name", default="pol", show_default=True, help="The installed contract to run.")
@click.option("--tls-cert", type=_file, help="The server's certificate chain (PEM); peers check its name.")
@click.option("--tls-key", type=_file, help="Its key (PEM).")
@click.option("--client-ca", type=_file, help="CA of the peers' TLS certificates (PEM): no other client gets in.")
@click.option("--plaintext", is_flag=True, help="Serve other machines without TLS, on a network that is protected.")
@click.option("--metrics", "operations", metavar="HOST:PORT", help="Serve /healthz and /metrics (Prometheus) there.")
@click.option(
    "--drain-s",
    default=Limits.drain_s,
    show_default=True,
    type=click.FloatRange(0, 600),
    help="Seconds that transactions under way get when it is stopped.",
)
@click.option(
    "--time-window-s",
    default=Limits.time_window_s,
    show_default=True,
    type=click.FloatRange(1, 86_400),
    help="How far a transaction's time may be from this machine's.",
)
@click.option(
    "--log", "log_style", type=click.Choice(["text", "json"]), default="text", show_default=True, help="How it logs."
)
@click.option(
    "--log-level",
    type=click.Choice(["debug", "info", "warning", "error"]),
    default="info",
    show_default=True,
    help="From which level on.",
)
@click.option("--json", "as_json", is_flag=True, help="Say by one JSON line on standard output that it serves.")
def serve(
    *,
    package_id: str | None,
    package_id_file: Path | None,
    listen: str,
    name: str,
    tls_cert: Path | None,
    tls_key: Path | None,
    client_ca: Path | None,
    plaintext: bool,
    operations: str | None,
    drain_s: float,
    time_window_s: float,
    log_style: str,
    log_level: str,
    as_json: bool,
) -> None:
    """Serve the contract until told to stop (Ctrl-C or SIGTERM); transactions under way then end first."""
    logs.set_up(log_style, log_level)
    tls = _tls(tls_cert, tls_key, client_ca)
    check_listen(listen, encrypted=tls is not None, plaintext=plaintext)
    if operations:
        check_listen(operations, encrypted=False, plaintext=True)
    contract = load_contract(name)
    server = ContractServer(
        contract,
        check_package_id(_package_id(package_id, package_id_file)),
        tls,
        Limits(drain_s=drain_s, time_window_s=time_window_s),
        Metrics(getattr(contract, "functions", ())),
    )

    def ready(watched_at: str) -> None:
        if as_json:
            answer = {
                "ready": True,
                "address": server.address,
                "package_id": server.package_id,
                "contract": name,
                "version": contract.version,
                "tls": "none" if tls is None else "mutual" if tls.mutual else "server",
                **({"metrics": watched_at} if watched_at else {}),
            }
            click.echo(json.dumps(answer))
            return
        click.echo(f"contract {name} {contract.version} at {server.address}, package {server.package_id}")
        click.echo("Ctrl-C stops it.")

    asyncio.run(_serve(server, listen, operations, name, ready))


async def _serve(
    server: ContractServer, listen: str, operations: str | None, name: str, ready: Callable[[str], None]
) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    watched = Operations(server)
    try:
        if operations:
            await watched.start(operations)
        await server.start(listen)
        server.metrics.info.set(1, contract=name, version=server.contract.version, package_id=server.package_id)
        ready(watched.address)
        await stop.wait()
        _log.info("stopping")
    finally:
        await server.stop()
        await watched.stop()


def _package_id(given: str | None, file: Path | None) -> str:
    if file is not None and given is None:
        return read_bounded(file, SettingsError, "package id", 4096).decode(errors="replace").strip()
    if given is None or file is not None:
        raise SettingsError("say the package's id by one of --package-id (or CHAINCODE_ID) and --package-id-file")
    return given


def _tls(certificate: Path | None, key: Path | None, client_ca: Path | None) -> Tls | None:
    if certificate is None and key is None and client_ca is None:
        return None
    if certificate is None or key is None:
        raise SettingsError("TLS takes --tls-cert and --tls-key together (and --client-ca for mutual TLS)")
    return Tls(certificate, key, client_ca)


@chaincode.command()
@click.option("--at", "address", required=True, metavar="HOST:PORT", help="What --metrics of `serve` was.")
@click.option("--json", "as_json", is_flag=True, help="The whole document.")
def health(*, address: str, as_json: bool) -> None:
    """Ask a running service how it is. Exit code 1 when it does not answer or is stopping."""
    import urllib.error  # noqa: PLC0415 - `serve` needs none of it, and has to stay small
    import urllib.request  # noqa: PLC0415

    check_listen(address, encrypted=False, plaintext=True)
    try:
        with urllib.request.urlopen(f"http://{address}/healthz", timeout=5) as answer:
            document = json.loads(answer.read(1 << 20))
    except urllib.error.HTTPError as error:
        with error:
            document = json.loads(error.read(1 << 20)) if error.code == 503 else {"status": f"HTTP {error.code}"}
    except (OSError, ValueError) as error:
        raise click.ClickException(f"no contract service answers at {address} ({error}); does it run?") from error
    if as_json:
        click.echo(json.dumps(document))
    else:
        click.echo(f"{document.get('status')}: package {document.get('package_id')}")
        click.echo(f"peers {', '.join(document.get('peers', ())) or 'none'}, {document.get('in_flight')} in flight")
    sys.exit(0 if document.get("status") == "OK" else 1)
