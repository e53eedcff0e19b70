"""``wonderland bus``: a router of Zenoh, by which agents and backends meet."""

from __future__ import annotations

import json
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from wonderland.service_manager import ServiceManager, held
from wonderland.toml_settings import SettingsError, Table, Text, load_toml

if TYPE_CHECKING:
    from wonderland_bus.settings import Router

EXTRA: Final = 'the bus needs what is not installed: pip install "wonderland-backend[zenoh]"'
_TOLD: Final = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}


class RouterSettings(Table, frozen=True):
    """The file of a router."""

    certificate: Path
    """This router’s certificate chain (PEM), for the host that others reach it by."""
    key: Path
    """Its private key (PEM)."""
    ca: Path
    """The authorities (PEM) whose certificates are let in: trust each with every name below."""
    agents: tuple[Text, ...] = ()
    """Common names of agents’ certificates: each hears and says what is its own."""
    backends: tuple[Text, ...] = ()
    """Common names of backends’ certificates."""
    listen: tuple[Text, ...] = ("tls/localhost:7447",)
    """Where it listens, `tls/HOST:PORT` each; `tls/0.0.0.0:7447` is every address of this machine."""


@click.group()
def bus() -> None:
    """A router of Zenoh, by which agents and backends meet."""


@bus.command("serve")
@click.option(
    "--config",
    "path",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Settings (TOML).",
)
@click.option("--check", is_flag=True, help="Read the settings and their files, say what they allow, and end.")
@click.option("--json", "as_json", is_flag=True, help="For machines: one line once it listens.")
def serve(path: Path, *, check: bool, as_json: bool) -> None:
    """Route until told to stop (SIGTERM, Ctrl-C).

    SIGHUP reads the settings and certificates anew, and then lets everybody come anew, which takes a moment and loses
    nothing. Settings that cannot be used change nothing.
    """
    with _clearly():
        router = _read(path)
        router.check()
    if check:
        click.echo(_told_of(router))
        return
    with held(_TOLD):  # before Zenoh's threads
        _route(router, path, as_json=as_json)


def _route(router: Router, path: Path, *, as_json: bool) -> None:
    import zenoh  # noqa: PLC0415 - an extra

    from wonderland_bus.session import open_router  # noqa: PLC0415 - the same

    zenoh.init_log_from_env_or("error,zenoh_link_tls=warn")  # whom it refused, and why
    with _clearly():
        session = open_router(router)
    manager = ServiceManager()
    click.echo(json.dumps({"ready": True, "listen": list(router.listen)}) if as_json else _told_of(router))
    manager.tell("READY=1")
    while signal.sigwait(_TOLD) is signal.SIGHUP:
        try:
            with _clearly():
                changed = _read(path)
                changed.check()
        except click.ClickException as cause:
            click.echo(f"goes on as before: {cause.message}", err=True)
            continue
        session.close()  # type: ignore[no-untyped-call]  # zenoh's stub says nothing of it
        with _clearly():
            session = open_router(changed)
        click.echo(_told_of(changed), err=as_json)
    manager.tell("STOPPING=1")
    session.close()  # type: ignore[no-untyped-call]


def _read(path: Path) -> Router:
    """What the file says. Raises `SettingsError`, `ImportError`."""
    from wonderland_bus.settings import Router, Tls  # noqa: PLC0415 - an extra

    found = load_toml(path, RouterSettings)
    return Router(
        tls=Tls(ca=found.ca, certificate=found.certificate, key=found.key),
        agents=found.agents,
        backends=found.backends,
        listen=found.listen,
    )


def _told_of(router: Router) -> str:
    return (
        f"{', '.join(router.listen)}: agents {', '.join(router.agents) or 'none'}; "
        f"backends {', '.join(router.backends) or 'none'}; nobody else is allowed anything"
    )


@contextmanager
def _clearly() -> Iterator[None]:
    """Raises `click.ClickException` for what is wrong with settings or the bus."""
    try:
        from wonderland_bus.errors import BusError  # noqa: PLC0415 - an extra
    except ImportError as cause:
        raise click.ClickException(f"{EXTRA} ({cause})") from None
    try:
        yield
    except (SettingsError, BusError) as cause:
        raise click.ClickException(str(cause)) from None
