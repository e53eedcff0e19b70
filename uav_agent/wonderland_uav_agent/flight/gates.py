"""Keeps a gatekeeper's pads as the ledger has them."""

from __future__ import annotations

import asyncio
import logging
from typing import Final, Protocol

from wonderland.proofs.records.pads import Pad
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_uav_agent.flight.approach import Gate
from wonderland_uav_agent.flight.gatekeeper import Gatekeeper

_log = logging.getLogger(__name__)

AGAIN_S: Final = 2.0
EVERY_S: Final = 60.0


class Pads(Protocol):
    """The part of the contract that is needed here."""

    async def read_pad(self, pad_id: str) -> Pad:
        """A pad with its commissioning."""
        ...


async def keep_gates(gatekeeper: Gatekeeper, ledger: Pads, pad_ids: frozenset[str]) -> None:
    """Read the pads again and again, until cancelled. What was read once is kept while the ledger is away."""
    told = False
    while True:
        known = {gate.pad_id: gate for gate in gatekeeper.gates}
        for pad_id in sorted(pad_ids):
            try:
                pad = await ledger.read_pad(pad_id)
            except LedgerError as error:
                _log.debug("pad %s cannot be read: %s", pad_id, error)
                continue
            if pad.commissioning is not None:
                known[pad_id] = Gate(pad_id, pad.commissioning.frame)
        gatekeeper.know(list(known.values()))
        lacking = sorted(pad_ids - known.keys())
        if lacking and not told:
            _log.warning("where %s is, is not known yet: nothing is held there", ", ".join(lacking))
        told = bool(lacking)
        await asyncio.sleep(AGAIN_S if lacking else EVERY_S)
