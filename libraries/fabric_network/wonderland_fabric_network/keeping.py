"""Keeping a network up: whatever ends by itself is brought up again.

A component that fails again and again is tried ever less often, so that its log can be read.
"""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Final

from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_network.agreement import load_agreement
from wonderland_fabric_network.bringing_up import bring_up, open_network
from wonderland_fabric_network.network import contract_component

if TYPE_CHECKING:
    from wonderland_fabric_network.binaries import Binaries
    from wonderland_fabric_network.bringing_up import Report
    from wonderland_fabric_network.layout import NetworkDirectory
    from wonderland_fabric_network.network import Network

LOOK_S: Final = 0.5
FIRST_PAUSE_S: Final = 1.0
LONGEST_PAUSE_S: Final = 60.0
STEADY_S: Final = 120.0
"""After so long without an end, the next one is taken care of at once again."""


def components(network: Network) -> list[str]:
    """All that should run."""
    agreement = load_agreement(network.directory.contract_file)
    names = [f"{msp_id}.ca" for msp_id in network.msp_ids]
    names += [member.component for member in (*network.orderers, *network.peers)]
    if agreement is not None:
        names += [contract_component(msp_id, agreement.slot) for msp_id in network.endorsers]
    return names


def ended(network: Network) -> list[str]:
    """What should run and does not."""
    return [name for name in components(network) if network.processes.pid(name) is None]


async def keep_up(directory: NetworkDirectory, binaries: Binaries, report: Report, stop: asyncio.Event) -> None:
    """Look after the network of a directory until `stop` is set. The network goes on running then.

    While another command works on the network (an upgrade, `down`), nothing is done; it stays down after `down`, until
    something of it runs again. Raises `LedgerError` for a directory without a network.
    """
    directory.require()
    pause_s, last_s = 0.0, 0.0
    while not stop.is_set():
        await _wait(stop, LOOK_S)
        network = open_network(directory)
        for name in network.processes.shorten_logs():
            report("keep", f"the log of {name} begins anew; what was there is in {network.processes.log(name)}.1")
        missing = ended(network)
        if not missing or len(missing) == len(components(network)):
            if time.monotonic() - last_s > STEADY_S:
                pause_s = 0.0
            continue
        report("keep", f"{', '.join(missing)} ended")
        await _wait(stop, pause_s)
        pause_s = min(LONGEST_PAUSE_S, max(FIRST_PAUSE_S, 2 * pause_s))
        try:
            with directory.lock():
                await bring_up(network, binaries, lambda _step, _text: None)
        except LedgerError as error:
            report("keep", f"not up again, once more in {pause_s:g} s: {error}")
        else:
            report("keep", f"{', '.join(missing)} up again")
        last_s = time.monotonic()


async def _wait(stop: asyncio.Event, seconds: float) -> None:
    try:
        async with asyncio.timeout(seconds):
            await stop.wait()
    except TimeoutError:
        return
