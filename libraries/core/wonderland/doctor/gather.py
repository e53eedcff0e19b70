"""Looking: what this machine, a connection to the ledger and a serial port are like. Nothing is changed."""

from __future__ import annotations

import asyncio
import os
import shutil
import stat
import subprocess
import time
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Final

from wonderland.doctor import checks
from wonderland.doctor.checks import Check, Clock
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_gateway.signing import verify

LEDGER_S: Final = 10.0
_PROJECT: Final = "wonderland-"


def now_ms() -> int:
    """Unix time."""
    return time.time_ns() // 1_000_000


def machine() -> Iterator[Check]:
    """What all parts share."""
    yield checks.versions({each.name: each.version for each in metadata.distributions() if _is_ours(each.name)})
    yield checks.clock(_clock())


def _is_ours(name: str | None) -> bool:
    return name is not None and name.startswith(_PROJECT)


def _clock() -> Clock | None:
    if (told := _said("chronyc", "-c", "-n", "tracking")) is not None:
        fields = told.strip().split(",")
        if len(fields) > 13:  # chronyc(1): 5th the offset in seconds, 14th the leap status
            return Clock("chrony", fields[13] != "Not synchronised", float(fields[4]))
    if (told := _said("timedatectl", "show", "--property=NTPSynchronized", "--value")) is not None and told.strip():
        return Clock("timedatectl", told.strip() == "yes")
    return None


def _said(*command: str) -> str | None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)  # noqa: S603 - our words
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout if done.returncode == 0 else None


def room(part: str, path: Path) -> Check:
    """Free space where this directory is, or will be."""
    there = next(each for each in (path, *path.parents) if each.exists())
    return checks.disk(part, str(path), shutil.disk_usage(there).free)


def port(part: str, address: str) -> Check:
    """Whether a board's port is there and may be used; ports by network are opened by nobody here."""
    if "://" in address:
        return Check(part, "port", "not_checked", f"{address} is reached by network")
    path = Path(address)
    if not path.exists():
        step = "plug the board in; ls /dev/serial/by-id shows what is there"
        return Check(part, "port", "failed", f"{address} is not there", step)
    if not stat.S_ISCHR(path.stat().st_mode):
        return Check(part, "port", "failed", f"{address} is no serial port", "ls /dev/serial/by-id shows them")
    if not os.access(path, os.R_OK | os.W_OK):
        step = "add the agent's user to the group that owns it (dialout), or run this as that user"
        return Check(part, "port", "failed", f"{address} may not be read and written", step)
    return Check(part, "port", "ok", f"{address} is there")


def ledger(part: str, path: Path, identity: str, now_ms: int) -> Iterator[Check]:
    """The connection file, who this part is, and whether the ledger answers."""
    try:
        connection = Connection.load(path)
        files = connection.files(identity)
        who = connection.identity(identity)
        signer = connection.signer(identity)
        probe = b"wonderland doctor"
        verify(who.public_key, probe, signer(probe))
    except LedgerError as error:
        yield Check(part, "ledger", "failed", str(error), f"put right what {path} names, or take a new one")
        return
    yield Check(part, "identity", "ok", f"{who.pol_id or identity} of {who.msp_id}; the key fits its certificate")
    yield checks.secret_file(part, str(files.key), files.key.stat().st_mode)
    certificate = who.certificate
    begins, ends = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    renew = "wonderland network renew, or a new enrolment at the organisation's CA"
    name = f"the certificate of {identity}"
    yield checks.certificate(part, name, int(begins.timestamp() * 1000), int(ends.timestamp() * 1000), now_ms, renew)
    yield asyncio.run(_height(part, connection, identity))


async def _height(part: str, connection: Connection, identity: str) -> Check:
    address = connection.gateway.address
    try:
        async with asyncio.timeout(LEDGER_S), connection.open_channel() as channel:
            gateway = Gateway(channel, connection.identity(identity), connection.signer(identity))
            height = await gateway.network(connection.channel).height()
    except (LedgerError, TimeoutError) as error:
        said = str(error) or f"no answer in {LEDGER_S:g} s"
        step = f"is the ledger at {address} running, and reachable from here?"
        return Check(part, "ledger", "failed", f"{address} does not answer: {said}", step)
    return Check(part, "ledger", "ok", f"{address}: channel {connection.channel} has {height} blocks")
