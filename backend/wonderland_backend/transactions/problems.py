"""Why a transaction came to nothing, in a form that a page can tell: whose word it is, and the very words."""

from __future__ import annotations

import re
from typing import Any, Final

from wonderland.messages import Language
from wonderland.problems import Said, said
from wonderland_fabric_gateway.gateway import CommitStatus, EndorseError, GatewayError
from wonderland_fabric_gateway.transactions import ValidationCode

REFUSED: Final = "refused"
"""The contract says no: role, state, or a bad argument."""
CHANGED: Final = "changed"
"""Somebody changed the record since it was looked at, or at the same moment."""
POLICY: Final = "policy"
"""Too few, or not the right organisations endorsed."""
INVALID: Final = "invalid"
"""The peers refused it for another reason; `validation` names it."""
LEDGER: Final = "ledger"
"""Peers or orderers refused it before or after the contract ran."""
_CODE: Final = re.compile(r"([A-Z][A-Z0-9_]{2,63}): ")
_CONFLICTS: Final = frozenset({ValidationCode.MVCC_READ_CONFLICT, ValidationCode.PHANTOM_READ_CONFLICT})
MAX_TEXT: Final = 1_000


def of_endorsement(error: EndorseError) -> dict[str, Any]:
    """From what the endorsers said."""
    said = error.chaincode_response
    if said is None:
        text = "; ".join([error.message, *(f"{each.msp_id}: {each.message}" for each in error.details)])
        return {"kind": CHANGED if error.is_mismatch else LEDGER, "text": text[:MAX_TEXT]}
    found = _CODE.match(said.message)
    problem: dict[str, Any] = {"kind": REFUSED, "status": said.status, "text": said.message[:MAX_TEXT]}
    if found is not None:
        problem |= {"code": found[1], "text": said.message[found.end() :][:MAX_TEXT]}
    organisations = sorted({each.msp_id for each in error.details if each.msp_id})
    return problem | ({"organisations": organisations} if organisations else {})


def of_submission(error: GatewayError) -> dict[str, Any]:
    """From the orderers' refusal."""
    return {"kind": LEDGER, "text": error.message[:MAX_TEXT]}


def of_outcome(status: CommitStatus) -> dict[str, Any]:
    """From the validation code of a transaction that is in a block and did nothing."""
    if status.code in _CONFLICTS:
        kind = CHANGED
    elif status.code == ValidationCode.ENDORSEMENT_POLICY_FAILURE:
        kind = POLICY
    else:
        kind = INVALID
    return {"kind": kind, "text": _kept(said("transaction_in_block", code=status.code_name, block=status.block_number))}


def changed(seen: tuple[int, int], found: tuple[int, int] | None) -> dict[str, Any]:
    """The record is not the one that the person had before their eyes."""
    before = "none" if seen[0] < 0 else str(seen[0])
    now = "none" if found is None else str(found[0])
    return {"kind": CHANGED, "text": _kept(said("transaction_overtaken", seen=before, found=now))}


def in_words(problem: dict[str, Any], language: Language) -> dict[str, Any]:
    """A problem as it is kept, its text in a language; the words of the contract and of peers stay theirs."""
    text = problem["text"]
    return problem | {"text": text if isinstance(text, str) else Said(text["key"], text["facts"]).text(language)}


def _kept(text: Said) -> dict[str, Any]:
    """A sentence of the catalogue, as it is stored until somebody reads it."""
    return {"key": text.key, "facts": text.facts}
