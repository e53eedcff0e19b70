"""The processes of a network whose servers something else runs: containers, system services, other machines."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Final

from wonderland_fabric_network.errors import ComponentError
from wonderland_fabric_network.processes import READY_S, ProcessTable, listens

if TYPE_CHECKING:
    from wonderland_fabric_network.processes import Launch

_POLL_S: Final = 0.1
_SEE_LOG: Final = "see its log where it runs (`docker compose logs`, `journalctl`)"


class Elsewhere(ProcessTable):
    """Nothing is started or stopped from here; whether a server runs is seen by whether it answers."""

    def pid(self, name: str) -> int | None:
        """None: an id on another host says nothing here."""
        del name
        return None

    def names(self) -> tuple[str, ...]:
        """None of them is ours."""
        return ()

    def start(self, launch: Launch) -> int:
        """Whoever runs the servers starts them."""
        del launch
        return 0

    async def wait_ready(self, launch: Launch, *, timeout_s: float = READY_S) -> None:
        """Wait until it listens everywhere. Raises `ComponentError` when that takes too long."""
        deadline = time.monotonic() + timeout_s
        for host, port in launch.listens:
            while not await listens(host, port):
                if time.monotonic() > deadline:
                    raise ComponentError(
                        launch.name,
                        f"does not listen on {host}:{port} after {timeout_s:g} s",
                        remedy=f"start it, and {_SEE_LOG}",
                    )
                await asyncio.sleep(_POLL_S)

    async def stop(self, name: str, *, patience_s: float = 0.0) -> bool:
        """False: it is not ours to stop."""
        del name, patience_s
        return False

    def tail(self, name: str, lines: int = 0) -> str:
        """Its log is elsewhere, too."""
        del name, lines
        return ""

    def failure(self, name: str, reason: str) -> ComponentError:
        """An error that says where to look."""
        return ComponentError(name, reason, remedy=_SEE_LOG)
