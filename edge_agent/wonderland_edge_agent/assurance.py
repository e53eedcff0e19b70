"""Which policies demand more assurance than a pad can reach, and what stands in the way on which node. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

from wonderland.uwb.agreed import out_of_reach
from wonderland.uwb.reach import reach
from wonderland_edge_agent.radios.between import channel_of

if TYPE_CHECKING:
    from wonderland.proofs.records.pads import Commissioning
    from wonderland.proofs.records.policies import Policy
    from wonderland.proofs.records.radios import NodeAbility
    from wonderland_edge_agent.radios import AnchorState

UNBOUND: Final = "nothing binds these boards' ranges to a session, so that proofs with them have assurance 0"


def beyond(commissioning: Commissioning, node: NodeAbility | None, policy: Policy, highest: int | None) -> str:
    """Why no proof at this pad by a drone with ``node`` has the assurance that a policy demands; empty where one can.

    ``highest``: what the pad's kind of boards bears at most, whatever they say; None: what they say counts.
    """
    if highest is not None and policy.min_assurance > highest:
        return f"the policy demands assurance {policy.min_assurance}, and {UNBOUND}"
    return out_of_reach(commissioning, node, policy)


def beyond_here(
    commissioning: Commissioning, policies: Mapping[str, Policy], states: Sequence[AnchorState], highest: int | None
) -> dict[str, str]:
    """The same by action, whatever the drone; with the nodes that lack what it takes, where they have said so."""
    out: dict[str, str] = {}
    for action, policy in policies.items():
        problem = beyond(commissioning, None, policy, highest)
        if problem:
            named = _named(commissioning, states, policy.min_assurance)
            out[action] = f"{problem} ({named})" if named else problem
    return out


def _named(commissioning: Commissioning, states: Sequence[AnchorState], level: int) -> str:
    able = {state.anchor_id: state.capabilities for state in states if state.capabilities is not None}
    first: dict[str, str] = {}
    for missing in reach(able, channel=channel_of(commissioning)).missing:
        if missing.told and missing.level <= level:
            first.setdefault(missing.node, missing.capability)  # who knows no UL-TDoA has none of its roles either
    who: dict[str, list[str]] = {}
    for node, capability in first.items():
        who.setdefault(capability, []).append(node)
    return "; ".join(f"{', '.join(names)} cannot do {capability}" for capability, names in who.items())
