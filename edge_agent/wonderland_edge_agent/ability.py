"""Whether the pad can prove anything now, and why not: one truth for people, metrics and the exit code. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from wonderland_edge_agent.radios import AnchorState
from wonderland_edge_agent.radios.nodes import MIN_ANCHORS

if TYPE_CHECKING:
    from wonderland.proofs.records.pads import Pad


@dataclass(frozen=True, slots=True, kw_only=True)
class Now:
    """What the agent knows at this moment.

    ``ledger_trouble``: why the ledger was last of no help; empty where it was. ``pad``: the pad's record, None before
    it was read. ``anchors``: None where the pad has no nodes of its own. ``spool_trouble``: why it takes no sessions.
    """

    ledger_trouble: str
    pad: Pad | None
    anchors: Sequence[AnchorState] | None
    moved: bool
    spool_trouble: str
    prekeys: int | None


def why_not(now: Now) -> list[str]:
    """Why no drone can be proved at this moment; empty where one can."""
    reasons = []
    if now.ledger_trouble:
        reasons.append(now.ledger_trouble)
    elif now.pad is None:
        reasons.append("the ledger has not said yet what it knows of this pad")
    if now.pad is not None and now.pad.status == "retired":
        reasons.append("the pad is retired")
    elif now.pad is not None and now.pad.commissioning is None:
        reasons.append("the pad is not commissioned (wonderland pad commission)")
    if now.moved:
        reasons.append("an anchor was moved: commission the pad again")
    if now.anchors is not None:
        reasons += _of_anchors(now.anchors, now.pad)
    if now.spool_trouble:
        reasons.append(now.spool_trouble)
    if now.prekeys == 0:
        reasons.append("no prekey is offered, so that no drone can ask")
    return reasons


def _of_anchors(states: Sequence[AnchorState], pad: Pad | None) -> list[str]:
    """An anchor that is silent while ranging counts as there: a drone out of reach makes all of them so."""
    commissioning = None if pad is None else pad.commissioning
    known = {state.anchor_id: state for state in states}
    wanted = list(known) if commissioning is None else [anchor.anchor_id for anchor in commissioning.anchors]
    down: dict[str, str] = {}
    for anchor_id in wanted:
        state = known.get(anchor_id)
        if state is None:
            down[anchor_id] = "no port configured"
        elif state.state == "down":
            down[anchor_id] = state.detail or "down"
    said = ", ".join(f"{anchor_id} ({why})" for anchor_id, why in down.items())
    if len(wanted) - len(down) < MIN_ANCHORS:
        return [f"{len(wanted) - len(down)} of {len(wanted)} anchors answer, {MIN_ANCHORS} are needed: {said}"]
    if wanted[0] in down:
        return [f"the anchor that speaks to the drone does not answer: {said}"]
    return []
