"""Who leads the ordering service, as the orderers' own metrics say; without a leader nothing is ordered."""

from __future__ import annotations

import asyncio
import re
import time
from typing import TYPE_CHECKING, Final

import httpx

from wonderland_fabric_network.concurrency import together
from wonderland_fabric_network.errors import ComponentError

if TYPE_CHECKING:
    from wonderland_fabric_network.network import Network

TIMEOUT_S: Final = 5.0
ELECTION_S: Final = 30.0
_POLL_S: Final = 0.05
_MAX_METRICS_BYTES: Final = 4 << 20
_LEADER: Final = re.compile(r'^consensus_\w+_is_leader\{[^}]*channel="([^"]+)"[^}]*\} (\d)', re.MULTILINE)


async def is_leader(operations: str, channel: str) -> bool | None:
    """Whether the orderer whose operations service that is leads; None when it does not say."""
    try:
        async with httpx.AsyncClient(timeout=TIMEOUT_S, trust_env=False) as http:
            response = await http.get(f"http://{operations}/metrics")
    except httpx.HTTPError:
        return None
    found = dict(_LEADER.findall(response.text[:_MAX_METRICS_BYTES]))
    return found[channel] == "1" if channel in found else None


async def wait_leader(network: Network) -> None:
    """Wait until an orderer leads: what is submitted before is refused. Raises `ComponentError`."""
    deadline = time.monotonic() + ELECTION_S
    while True:
        leads = await together(
            is_leader(network.address(member, "operations"), network.channel) for member in network.orderers
        )
        if any(leads):
            return
        if time.monotonic() > deadline:
            member = network.orderers[0]
            running = [each.component for each in network.orderers if network.processes.pid(each.component)]
            raise ComponentError(
                member.component,
                f"no orderer leads {network.channel} after {ELECTION_S:g} s; of {len(network.orderers)} run "
                f"{len(running)}: {', '.join(running)}",
                log_tail=network.processes.tail(member.component),
                remedy="a majority (bft: more than two thirds) must run and reach each other; `wonderland network up`",
            )
        await asyncio.sleep(_POLL_S)
