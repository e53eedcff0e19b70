"""Policies: set for a pad or all, an action or all; the most specific one holds. Two people set them (`changes`)."""

from __future__ import annotations

from typing import Final

from wonderland.proofs.records import keys
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.changes import PolicyChange
from wonderland.proofs.records.policies import Policy
from wonderland_chaincode.contract import pads
from wonderland_chaincode.contract.call import Answer, Call
from wonderland_chaincode.contract.errors import refused
from wonderland_chaincode.contract.witnesses import WITNESSED

ANY: Final = "*"


def keys_for(pad_id: str, action: str) -> list[str]:
    """Where policies for an action at a pad may stand, the most specific first."""
    scopes = ((pad_id, action), (pad_id, ANY), (ANY, action), (ANY, ANY))
    return [keys.composite(keys.POLICY, *scope) for scope in scopes]


async def in_force(call: Call, pad_id: str, action: str) -> Policy:
    """The policy that holds for an action at a pad."""
    return await call.find_first(keys_for(pad_id, action), Policy) or Policy()


async def require_possible(call: Call, wanted: PolicyChange) -> None:
    """Raises ContractError for a policy that no session could fulfil."""
    if wanted.pad_id != ANY:
        await pads.require_in_service(call, wanted.pad_id)
    witness_id = wanted.policy.witness_pad_id
    if witness_id is None and wanted.policy.min_assurance >= WITNESSED:
        raise refused(
            "WITNESS_MISSING", f"policy: assurance {wanted.policy.min_assurance} needs a witness (witness_pad_id)"
        )
    if witness_id is not None and witness_id == wanted.pad_id:
        raise refused("WITNESS_IS_PAD", f"policy: pad {witness_id} cannot be its own witness; name another pad")
    if witness_id is not None:
        await pads.require_in_service(call, witness_id)


async def read(call: Call, argument: tx.PolicyFor) -> Answer:
    """ReadPolicy."""
    return Answer((await in_force(call, argument.pad_id, argument.action)).to_json())
