"""Programs of the operator's: run without a shell, within a time, and what went wrong is told."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence


async def run_program(command: Sequence[str], limit_s: float) -> str:
    """What went wrong; empty where it ended with status 0. One that takes longer than ``limit_s`` is killed."""
    try:
        process = await asyncio.create_subprocess_exec(
            *command, stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL
        )
    except OSError as error:
        return f"{command[0]} cannot be run: {error.strerror or error}"
    try:
        async with asyncio.timeout(limit_s):
            status = await process.wait()
    except TimeoutError:
        return f"{command[0]} did not end within {limit_s:g} s"
    finally:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
    return "" if status == 0 else f"{command[0]} ended with status {status}"
