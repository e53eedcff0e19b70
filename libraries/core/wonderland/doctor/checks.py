"""What a check finds, and the words for what every part has: clock, disk, files, ports, versions. No I/O."""

from __future__ import annotations

import stat
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

Status = Literal["ok", "warning", "failed", "not_checked"]
CLOCK_WARNING_S: Final = 0.1
CLOCK_FAILED_S: Final = 1.0
"""A clock three seconds off makes every proof inconclusive; at ten metres a second, one second is ten metres."""
FREE_WARNING_BYTES: Final = 1 << 30
FREE_FAILED_BYTES: Final = 64 << 20
ENDS_SOON_DAYS: Final = 14
DAY_MS: Final = 86_400_000
BACKUP_DAYS: Final = 2


@dataclass(frozen=True)
class Check:
    """One thing that was looked at; `next_step`: what to do, where it is not `ok`."""

    part: str
    what: str
    status: Status
    text: str
    next_step: str = ""

    def to_json(self) -> dict[str, Any]:
        """One object, as ``--json`` prints it."""
        return asdict(self)


@dataclass(frozen=True)
class Clock:
    """What keeps this machine's time: whether it is in step, and how far off, where that is known."""

    keeper: str
    in_step: bool
    offset_s: float | None = None


def clock(found: Clock | None) -> Check:
    """Whether claims of this machine will have the right time."""
    what = "clock"
    if found is None:
        step = "install chrony, or enable systemd-timesyncd"
        return Check("machine", what, "not_checked", "nothing here says whether the clock is in step", step)
    step = f"let {found.keeper} reach a time server, or a GPS receiver; until then proofs are inconclusive"
    if not found.in_step:
        return Check("machine", what, "failed", f"{found.keeper}: the clock is not in step", step)
    if found.offset_s is None:
        return Check("machine", what, "ok", f"{found.keeper}: in step")
    off = abs(found.offset_s)
    status: Status = "failed" if off >= CLOCK_FAILED_S else "warning" if off >= CLOCK_WARNING_S else "ok"
    return Check("machine", what, status, f"{found.keeper}: {off:.3f} s off", "" if status == "ok" else step)


def versions(installed: Mapping[str, str]) -> Check:
    """Whether all parts of this project that are installed are of one version."""
    if len(set(installed.values())) <= 1:
        return Check("machine", "versions", "ok", f"Wonderland {next(iter(installed.values()), 'is not installed')}")
    text = ", ".join(f"{name} {version}" for name, version in sorted(installed.items()))
    return Check("machine", "versions", "failed", f"several at once: {text}", "install all of one version")


def disk(part: str, path: str, free_bytes: int) -> Check:
    """Room where a part writes."""
    text = f"{free_bytes / (1 << 30):.1f} GiB free at {path}"
    if free_bytes >= FREE_WARNING_BYTES:
        return Check(part, "disk", "ok", text)
    status: Status = "failed" if free_bytes < FREE_FAILED_BYTES else "warning"
    return Check(part, "disk", status, text, "make room, or move it to a larger disk")


def secret_file(part: str, path: str, mode: int) -> Check:
    """Whether a key is its owner's alone."""
    if mode & (stat.S_IRWXG | stat.S_IRWXO) & ~stat.S_IRGRP:
        step = f"chmod 600 {path}; and take another key, if somebody else uses this machine"
        return Check(part, "key", "failed", f"{path} has mode {stat.S_IMODE(mode):04o}", step)
    return Check(part, "key", "ok", f"{path} has mode {stat.S_IMODE(mode):04o}")


def certificate(part: str, name: str, not_before_ms: int, not_after_ms: int, now_ms: int, renew: str) -> Check:
    """Whether a certificate is good now, and for how long."""
    days = (not_after_ms - now_ms) / DAY_MS
    if now_ms < not_before_ms:
        text = f"{name} is not good yet"
        return Check(part, "certificate", "failed", text, "is this machine's clock right?")
    if days <= 0:
        return Check(part, "certificate", "failed", f"{name} has expired {-days:.0f} days ago", renew)
    if days < ENDS_SOON_DAYS:
        return Check(part, "certificate", "warning", f"{name} ends in {days:.0f} days", renew)
    return Check(part, "certificate", "ok", f"{name} is good for {days:.0f} days")


def backups(newest_ms: int | None, where: str, now_ms: int) -> Check:
    """How old the newest backup is."""
    step = f"wonderland backup --to {where}, and enable wonderland-backup.timer"
    if newest_ms is None:
        return Check("backend", "backup", "failed", f"there is none in {where}", step)
    days = (now_ms - newest_ms) / DAY_MS
    status: Status = "ok" if days < BACKUP_DAYS else "warning"
    return Check("backend", "backup", status, f"the newest is {days:.1f} days old", "" if status == "ok" else step)


def worst(found: Iterator[Check] | list[Check]) -> Status:
    """What the whole is worth."""
    order: tuple[Status, ...] = ("failed", "warning", "not_checked", "ok")
    there = {each.status for each in found}
    return next((each for each in order if each in there), "ok")
