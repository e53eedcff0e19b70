"""``wonderland world run --scenario``: until Ctrl-C, and nothing is left."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

from rich.console import Console
from rich.live import Live

from wonderland_simulator.practice.reading import Scenario
from wonderland_simulator.practice.showing import table, what_to_enter
from wonderland_simulator.practice.world import PracticeWorld

REFRESH_S: Final = 0.25
KEPT_LINES: Final = 8


async def run_scenario(
    scenario: Scenario, console: Console, *, as_json: bool = False, greeting: Sequence[str] | None = None
) -> None:
    """Until SIGINT, SIGTERM or cancelled. ``greeting``: what is said once every port is there. Raises OSError."""
    said: deque[str] = deque(maxlen=KEPT_LINES)
    live = console.is_terminal and not as_json

    def line(text: str) -> None:
        console.print(text, markup=False, highlight=False, soft_wrap=True)

    def say(t_s: float, text: str) -> None:
        if as_json:
            line(json.dumps({"t_s": round(t_s, 2), "said": text}))
        elif live:
            said.append(f"{t_s:7.1f} s  {text}")
        else:
            line(f"{t_s:.1f} s: {text}")

    def ready() -> None:
        if as_json:
            line(json.dumps({"ready": True, "ports": {name: str(port.path) for name, port in world.ports.items()}}))
        else:
            line("\n".join(greeting or (*what_to_enter(scenario), "It flies. Ctrl-C ends it.")))

    world = PracticeWorld(scenario, say)
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    working = asyncio.ensure_future(world.run(ready))
    working.add_done_callback(lambda _: stop.set())
    with _shown(console, live, lambda: table(world, list(said))) as refresh:
        while not stop.is_set():
            refresh()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), REFRESH_S)
    working.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await working


@contextlib.contextmanager
def _shown(console: Console, live: bool, render: Callable[[], object]):  # type: ignore[no-untyped-def] # noqa: ANN202
    if not live:
        yield lambda: None
        return
    with Live(console=console, auto_refresh=False, transient=True) as shown:
        yield lambda: shown.update(render(), refresh=True)  # type: ignore[arg-type]
