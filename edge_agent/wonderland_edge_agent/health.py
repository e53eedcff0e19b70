"""How the pad is: told to the backend as telemetry, and to ``wonderland pad status`` by a small file."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from wonderland import __version__
from wonderland.telemetry import AnchorHealth, Health, clean
from wonderland.uwb.reach import reach
from wonderland_edge_agent.assurance import UNBOUND
from wonderland_edge_agent.drift import DriftState
from wonderland_edge_agent.radios import AnchorState
from wonderland_edge_agent.radios.between import channel_of
from wonderland_edge_agent.receiver import ReceiverCounts
from wonderland_edge_agent.reporting import SpoolReporter
from wonderland_edge_agent.spool import SpoolStatus
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.files import read_bounded, write_atomic

if TYPE_CHECKING:
    from wonderland.proofs.records.pads import Commissioning

_log = logging.getLogger(__name__)

HEALTH_S: Final = 10.0
LOOK_S: Final = 1.0
"""Between two looks whether something changed that is told at once."""


MAX_DETAIL: Final = 200


class StatusError(LedgerError):
    """The agent's status file is missing or no status; the text says what to do."""


def health_record(
    anchors: Sequence[AnchorState],
    spool: SpoolStatus,
    receiver: ReceiverCounts,
    prekeys: int | None,
    drift: DriftState | None = None,
) -> Health:
    """A pad's word on itself."""
    return Health(
        anchors=tuple(
            AnchorHealth(
                anchor_id=anchor.anchor_id,
                state=anchor.state,
                firmware=anchor.firmware or None,
                detail=None if anchor.state == "up" else clean(anchor.detail, MAX_DETAIL) or None,
            )
            for anchor in anchors
        ),
        spool=spool.health(),
        receiver=receiver.health(),
        prekeys=prekeys,
        version=__version__,
        drift=None if drift is None else drift.health(),
    )


def reach_of(
    anchors: Sequence[AnchorState], commissioning: Commissioning | None, highest: int | None
) -> dict[str, Any] | None:
    """Highest assurance that the nodes can bear and what they lack for more; None while none has said what it can.

    ``unknown``: anchors whose nodes have not said it; they are left out.
    """
    if highest is not None:
        return {"assurance": highest, "missing": [UNBOUND], "unknown": []}
    pad = {f"anchor {each.anchor_id}": each.capabilities for each in anchors if each.capabilities is not None}
    if not pad:
        return None
    found = reach(pad, channel=channel_of(commissioning))
    unknown = [each.anchor_id for each in anchors if each.capabilities is None]
    return {"assurance": found.level, "missing": [str(each) for each in found.missing], "unknown": unknown}


async def tell_health(
    status: Callable[[], dict[str, Any]],
    health: Callable[[], Health],
    reporter: SpoolReporter,
    files: Sequence[tuple[Path | None, Callable[[Path, dict[str, Any]], None]]],
) -> None:
    """Tell until cancelled: to the backend, and to each file that there is.

    Every ten seconds, and within one when an anchor, the drift or the offer of prekeys comes to another state,
    or something else keeps the pad from proving.
    """
    while True:
        now, told = status(), health()
        reporter.offer(now["t_ms"], told)
        for path, write in files:
            if path is not None:
                try:
                    await asyncio.to_thread(write, path, now)
                except LedgerError as error:
                    _log.warning("%s", error)
        for _ in range(round(HEALTH_S / LOOK_S)):
            await asyncio.sleep(LOOK_S)
            if _states(health()) != _states(told) or _reasons(status()) != _reasons(now):
                break


def _reasons(status: dict[str, Any]) -> tuple[object, ...]:
    return status.get("cannot_prove"), status.get("not_known"), status.get("not_for")


def _states(health: Health) -> tuple[object, ...]:
    anchors = tuple((anchor.anchor_id, anchor.state) for anchor in health.anchors)  # details may change all the time
    return anchors, None if health.drift is None else health.drift.state, bool(health.prekeys)


def write_status(path: Path, status: dict[str, Any]) -> None:
    """Replace the status file. Raises LedgerError (FileWriteError) when the disk does not take it."""
    write_atomic(path, json.dumps(status, indent=2, ensure_ascii=False).encode() + b"\n")


def read_status(path: Path) -> dict[str, Any]:
    """What the agent last said of itself. Raises StatusError."""
    if not path.exists():
        raise StatusError(f"its agent has not run yet (there is no {path}); wonderland pad run starts it")
    data = read_bounded(path, StatusError, "status", limit=1 << 20)
    try:
        status = json.loads(data.decode())
    except (ValueError, RecursionError) as cause:
        raise StatusError(f"{path} is no status file ({cause}); the agent writes it anew when it runs") from cause
    if not isinstance(status, dict):
        raise StatusError(f"{path} is no status file; the agent writes it anew when it runs")
    return status
