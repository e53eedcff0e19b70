"""Whether the pad can prove anything now, and why not: one truth for people, metrics and the exit code. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from wonderland.proofs.admission import CHECKED_ANCHORS
from wonderland.proofs.records.fields import ACTIONS
from wonderland.uwb.reach import reach
from wonderland_edge_agent.radios import AnchorState
from wonderland_edge_agent.radios.anchors import MIN_ANCHORS
from wonderland_edge_agent.radios.between import channel_of

if TYPE_CHECKING:
    from wonderland.proofs.records.pads import Pad


@dataclass(frozen=True, slots=True, kw_only=True)
class Now:
    """What the agent knows at this moment.

    ``ledger_trouble``: why the ledger was last of no help; empty where it was. ``pad``: the pad's record, None before
    it was read. ``anchors``: None where the pad has no nodes of its own. ``moved``: what stands elsewhere than
    commissioned. ``spool_trouble``: why it takes no sessions. ``looks``: whether the anchors call a roll now and then.
    """

    ledger_trouble: str
    pad: Pad | None
    anchors: Sequence[AnchorState] | None
    moved: str
    spool_trouble: str
    prekeys: int | None
    looks: bool = False
    beyond: Mapping[str, str] = field(default_factory=dict)
    """By action, why no proof has the assurance that its policy demands."""


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
        reasons.append(now.moved)
    if now.anchors is not None:
        reasons += _of_anchors(now.anchors, now.pad) or (_not_looked_at(now.anchors, now.pad) if now.looks else [])
    if {*now.beyond} >= {*ACTIONS}:
        reasons += [f"{text} (to {_listed(actions)})" for text, actions in _by_text(now.beyond).items()]
    if now.spool_trouble:
        reasons.append(now.spool_trouble)
    if now.prekeys == 0:
        reasons.append("no prekey is offered, so that no drone can ask")
    return reasons


def not_for(now: Now) -> list[str]:
    """Actions whose policy demands more assurance than the pad can reach, where others do not."""
    if {*now.beyond} >= {*ACTIONS}:
        return []
    return [f"cannot prove to {_listed(actions)}: {text}" for text, actions in _by_text(now.beyond).items()]


def _by_text(beyond: Mapping[str, str]) -> dict[str, list[str]]:
    out: dict[str, list[str]] = {}
    for action, text in beyond.items():
        out.setdefault(text, []).append(action)
    return out


def _listed(actions: Sequence[str]) -> str:
    return ", ".join("take off" if action == "takeoff" else action for action in actions)


def not_known(now: Now) -> list[str]:
    """What nobody can know at this moment, where nothing that is known keeps the pad from proving."""
    if now.anchors is None:
        return []
    wanted, missing = _missing(now.anchors, now.pad)
    unproven = [state.anchor_id for state in now.anchors if state.unproven and state.anchor_id not in missing]
    needed = _needed(len(wanted))
    if len(wanted) - len(missing) < needed or len(wanted) - len(missing) - len(unproven) >= needed:
        return []
    who = ", ".join(unproven)
    return [
        f"the anchors do not hear one another: whether they range is not known until a drone has been ranged ({who})"
    ]


def goes_on_without(now: Now) -> list[str]:
    """Anchors that are missing, or cannot speak, and that the pad does not need; empty where it can prove nothing."""
    if now.anchors is None:
        return []
    wanted, missing = _missing(now.anchors, now.pad)
    enough = len(wanted) - len(missing) >= _needed(len(wanted))
    if not enough:
        return []
    mute = [f"the voice of {each.anchor_id} ({each.detail})" for each in _mute(now.anchors)]
    return [f"{anchor_id} ({why})" for anchor_id, why in missing.items()] + mute


def _mute(states: Sequence[AnchorState]) -> list[AnchorState]:
    return [state for state in states if state.ranges and not state.speaks]


def _of_anchors(states: Sequence[AnchorState], pad: Pad | None) -> list[str]:
    wanted, missing = _missing(states, pad)
    there, needed = len(wanted) - len(missing), _needed(len(wanted))
    if there >= needed:
        mute = _mute(states)
        if not mute or any(state.ranges and state.speaks for state in states):
            return []
        return [f"no anchor can speak to the drone: {', '.join(f'{each.anchor_id} ({each.detail})' for each in mute)}"]
    said = ", ".join(f"{anchor_id} ({why})" for anchor_id, why in missing.items())
    return [f"{there} of {len(wanted)} anchors can range, {needed} are needed: {said}"]


def _not_looked_at(states: Sequence[AnchorState], pad: Pad | None) -> list[str]:
    """Seconds after the start, or after nodes came back, nobody has looked yet whether the anchors range."""
    wanted, missing = _missing(states, pad)
    unseen = [state.anchor_id for state in states if state.unseen and state.anchor_id in {*wanted} - {*missing}]
    if len(wanted) - len(missing) - len(unseen) >= _needed(len(wanted)):
        return []
    return [f"not known yet: a roll call has still to show whether the anchors range ({', '.join(unseen)})"]


def _needed(commissioned: int) -> int:
    """Where the contract can check four anchors' ranges against each other, it verifies on no fewer."""
    return max(MIN_ANCHORS, min(commissioned, CHECKED_ANCHORS))


def _lacks(states: Sequence[AnchorState], pad: Pad | None) -> dict[str, list[str]]:
    """By anchor, what its node says that it cannot do and without which it ranges nobody."""
    channel = channel_of(None if pad is None else pad.commissioning)
    able = {state.anchor_id: state.capabilities for state in states if state.capabilities is not None}
    out: dict[str, list[str]] = {}
    for missing in reach(able, channel=channel).missing:
        if missing.told and missing.level == 1:
            out.setdefault(missing.node, []).append(missing.capability)
    return out


def _missing(states: Sequence[AnchorState], pad: Pad | None) -> tuple[list[str], dict[str, str]]:
    """The anchors of the pad, and why some of them measure nothing.

    One that is silent like all others in a session counts as there: a drone out of reach makes all of them so.
    """
    lacks = _lacks(states, pad)
    commissioning = None if pad is None else pad.commissioning
    known = {state.anchor_id: state for state in states}
    wanted = list(known) if commissioning is None else [anchor.anchor_id for anchor in commissioning.anchors]
    missing: dict[str, str] = {}
    for anchor_id in wanted:
        state = known.get(anchor_id)
        if state is None:
            missing[anchor_id] = "no port configured"
        elif not state.ranges:
            missing[anchor_id] = state.detail or state.state
        elif anchor_id in lacks:
            missing[anchor_id] = f"cannot do {', '.join(lacks[anchor_id])}"
    return wanted, missing
