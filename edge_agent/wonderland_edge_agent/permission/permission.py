"""Permission at the pad. Whatever it drives, it is granted by a committed verdict only and always taken back."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Sequence
from typing import Final, Protocol

from wonderland.proofs.records.verdicts import Verdict
from wonderland_edge_agent.programs import run_program

_log = logging.getLogger(__name__)

COMMAND_TIMEOUT_S: Final = 5.0


class Permission(Protocol):
    """Something at the pad that a permission switches."""

    async def grant(self, verdict: Verdict) -> None:
        """The drone of this verdict may act now."""

    async def withdraw(self, verdict: Verdict, reason: str) -> None:
        """It may no longer: done, lapsed, or cancelled."""


class LogPermission:
    """Writes it into the log."""

    async def grant(self, verdict: Verdict) -> None:
        """Write one line to the log, and nothing else."""
        _log.info("permission: %s may %s at %s", verdict.uav_id, verdict.action, verdict.pad_id)

    async def withdraw(self, verdict: Verdict, reason: str) -> None:
        """Write one line to the log, and nothing else."""
        _log.info("permission of %s at %s withdrawn: %s", verdict.uav_id, verdict.pad_id, reason)


class CommandPermission:
    """Runs a program of the operator's (a relay, a dock) with: granted or withdrawn, drone, action, session.

    No shell takes part. A program that fails or hangs is reported and changes nothing on the ledger.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._command = tuple(command)

    async def grant(self, verdict: Verdict) -> None:
        """Run it with ``granted``."""
        await self._run("granted", verdict)

    async def withdraw(self, verdict: Verdict, reason: str) -> None:
        """Run it with ``withdrawn``."""
        del reason
        await self._run("withdrawn", verdict)

    async def _run(self, word: str, verdict: Verdict) -> None:
        command = (*self._command, word, verdict.uav_id, verdict.action, verdict.session_id)
        problem = await run_program(command, COMMAND_TIMEOUT_S)
        if problem:
            _log.error("permission: %s", problem)


class Permissions:
    """Several at once; one that fails keeps no other from switching."""

    def __init__(self, *parts: Permission) -> None:
        self._parts = parts

    async def grant(self, verdict: Verdict) -> None:
        """Tell each of the parts."""
        await self._all([part.grant(verdict) for part in self._parts])

    async def withdraw(self, verdict: Verdict, reason: str) -> None:
        """Tell each of the parts."""
        await self._all([part.withdraw(verdict, reason) for part in self._parts])

    @staticmethod
    async def _all(calls: Sequence[Awaitable[None]]) -> None:
        for outcome in await asyncio.gather(*calls, return_exceptions=True):
            if isinstance(outcome, Exception):
                _log.error("permission: a part of it failed", exc_info=outcome)
