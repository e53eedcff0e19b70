"""The verification: thirteen steps, one function each, in their order. Each says what it proves and what it does not.

A step returns in words what it found, or raises `StepError`; `NotCheckedError` where it cannot be made.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from wonderland_evidence.block_steps import (
    check_chain,
    check_data,
    check_orderers,
    check_ordering_policy,
    check_trust,
)
from wonderland_evidence.case import Case
from wonderland_evidence.record_steps import check_decision, check_records, check_timestamps, check_validity
from wonderland_evidence.transaction_steps import (
    check_endorsement_policy,
    check_endorsements,
    check_proposals,
    check_senders,
)
from wonderland_evidence.trust import Pins

Check = Callable[[Case, Pins], str]


@dataclass(frozen=True)
class Step:
    """A step's number is its place in `STEPS`, from 1. `may_lack`: evidence is whole without it.

    `without_verdict`: what it proves where the file has no verdict, if that is less.
    """

    name: str
    check: Check
    proves: str
    does_not_prove: str
    may_lack: bool = False
    without_verdict: str = ""


STEPS: Final = (
    Step(
        "trust",
        check_trust,
        "The blocks begin with the channel's pinned first block; between it and the newest configuration in the file "
        "none is left out, and all organisations' root certificates are pinned.",
        "That the pins are right: compare them by another way. That no configuration is newer than the file's newest.",
    ),
    Step(
        "chain",
        check_chain,
        "Blocks of the session stand unchanged between those blocks before and after them that are in the file.",
        "Anything by itself: whoever makes blocks can chain them. Steps 4 and 5 say who made these. Nor which block is "
        "the channel's newest: nothing in a file can show that.",
    ),
    Step(
        "data",
        check_data,
        "Each block's header covers exactly these transactions.",
        "That they are valid: a block also holds what was refused. That orderers made the block: steps 4 and 5 do. "
        "Whoever holds enough orderers' keys can leave transactions out of a block, or put one in twice.",
    ),
    Step(
        "orderers",
        check_orderers,
        "Orderers of the channel, with certificates that were neither expired nor revoked there, signed these blocks.",
        "That all orderers are honest; and a block's time is only its senders' word.",
    ),
    Step(
        "ordering policy",
        check_ordering_policy,
        "As many orderers signed as the channel asks for: one on Raft, a quorum on BFT.",
        "On Raft, that the one orderer's key was not stolen: only a second block of the same number would show it.",
    ),
    Step(
        "senders",
        check_senders,
        "Each transaction was sent by the holder of that certificate, and nothing in it was changed.",
        "When: the time in a transaction is the sender's word, bounded by the ledger to 15 minutes.",
    ),
    Step(
        "proposals",
        check_proposals,
        "What the peers endorsed is the outcome of what the sender asked.",
        "That the outcome is right: see the last step.",
    ),
    Step(
        "endorsements",
        check_endorsements,
        "Peers of the channel signed each outcome: what was read, in which version, and what is written.",
        "That the peers ran the contract that was agreed on. The last step shows it of the session's own "
        "transactions, and not of those that wrote the drone's record, its authorisation or maintenance, the pad's "
        "survey or the policy.",
    ),
    Step(
        "endorsement policy",
        check_endorsement_policy,
        "All organisations that had to agree did: by the contract's definition, which was agreed on in transactions of "
        "this file, and by the records' own policies.",
        "That these organisations are independent of one another. On an embedded ledger they are not: one process "
        "holds all their keys.",
    ),
    Step(
        "records",
        check_records,
        "Request, measured ranges, survey, policy and verdict belong together; each was read in the version that was "
        "then the newest.",
        "That nothing about this session was left out: its end, or all from the verdict on, can be cut off a file. "
        "That what pad and drone brought is true: that is what the verdict weighs. Whoever holds enough orderers' "
        "keys could put an older record in a newer one's place, where the outcome stays the same to the last bit.",
        without_verdict="The request, and what it rests on, belong together; each was read in the version that was "
        "then the newest. The file has no verdict.",
    ),
    Step(
        "validity",
        check_validity,
        "Peers of enough organisations signed that the channel holds the session's transactions as valid. No signature "
        "in a block says so.",
        "That peers who all lie together cannot be found out by this file alone.",
    ),
    Step(
        "time-stamp",
        check_timestamps,
        "A pinned time-stamping service saw the block's hash at that time: the session is not younger.",
        "That it is not older; and the service must be trusted.",
        may_lack=True,
    ),
    Step(
        "decision",
        check_decision,
        "The contract of this verifier decides the same from these records, to the last bit, in each of the session's "
        "own transactions in the file.",
        "That no drone can deceive the measurement: see the method's limits for this assurance level. Transactions "
        "before the session (drone, authorisation, maintenance, survey, policy) are not run again: their peers' word "
        "counts.",
    ),
)
