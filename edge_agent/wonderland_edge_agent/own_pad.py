"""The pad's own record on the ledger, and the survey that a session rests on."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Final

from wonderland.proofs import encoding
from wonderland.proofs.records.fields import ACTIONS

if TYPE_CHECKING:
    from wonderland.proofs.records.pads import Commissioning, Pad
    from wonderland.proofs.records.policies import Policy
    from wonderland.proofs.records.sessions import Session
    from wonderland_edge_agent.ports import PadLedger

LOOKS: Final = 5
PAUSE_S: Final = 0.4
"""The survey that a session rests on is on the ledger; a peer may be behind it, or another one may have replaced it."""


class OwnPad:
    """Read once, and again when the ledger says that it changed."""

    def __init__(self, pad_id: str, ledger: PadLedger) -> None:
        self._pad_id = pad_id
        self._ledger = ledger
        self._pad: Pad | None = None

    def changed(self) -> None:
        """It was commissioned or retired: what was read is old."""
        self._pad = None

    async def read(self) -> Pad:
        """As it was last read. Raises AwayError and RefusedError."""
        if self._pad is None:
            self._pad = await self._ledger.read_pad(self._pad_id)
        return self._pad

    async def refresh(self) -> Pad:
        """As it is now. Raises as ``read``."""
        self._pad = await self._ledger.read_pad(self._pad_id)
        return self._pad

    async def policies(self) -> dict[str, Policy]:
        """What holds now for each action. Raises as ``read``."""
        found = await asyncio.gather(*(self._ledger.read_policy(self._pad_id, action) for action in ACTIONS))
        return dict(zip(ACTIONS, found, strict=True))

    async def commissioning_of(self, session: Session) -> Commissioning | None:
        """The survey that the session rests on; None where it is no longer the pad's. Raises as ``read``."""
        for attempt in range(LOOKS):
            if attempt > 1:
                await asyncio.sleep(PAUSE_S)
            if attempt:
                self.changed()
            pad = await self.read()
            if pad.commissioning_sha256 == session.commissioning_sha256:
                commissioning = pad.commissioning
                # The digest is checked, not believed: the pad tells its ranges in the order of these anchors.
                if commissioning is not None and (
                    encoding.digest(commissioning.to_json()).hex() == session.commissioning_sha256
                ):
                    return commissioning
        return None
