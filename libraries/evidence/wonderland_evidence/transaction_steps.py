"""Steps 6 to 9: the transactions. Who sent each, what it answers, who endorsed it, and whether that sufficed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from wonderland_evidence.derive import LIFECYCLE, definition, keys_written, own_policy
from wonderland_evidence.errors import StepError
from wonderland_evidence.places import name_of_place, one_process, used, within
from wonderland_fabric_gateway.signature_policies import parse_policy, satisfied
from wonderland_fabric_gateway.verification.transaction_checks import (
    check_proposal,
    check_sender,
    counted_endorsers,
    endorsers,
    policy_holds,
)

if TYPE_CHECKING:
    from wonderland_evidence.case import Case
    from wonderland_evidence.trust import Pins
    from wonderland_fabric_gateway.signature_policies import Signer
    from wonderland_fabric_gateway.transactions import Version
    from wonderland_fabric_gateway.verification.channel_trust import ChannelTrust

CONTRACT_POLICY: Final = "/Channel/Application/Endorsement"
LIFECYCLE_POLICY: Final = "/Channel/Application/LifecycleEndorsement"


def check_senders(case: Case, pins: Pins) -> str:
    """6: each transaction is its sender's: signature, certificate in force then, id, channel, type."""
    del pins
    found = used(case)
    for place, why in found.items():
        transaction = case.transaction(place, why)
        with within(name_of_place(place)):
            check_sender(case.trust_before(place.block), transaction)
    return f"{len(found)} transactions"


def check_proposals(case: Case, pins: Pins) -> str:
    """7: what was endorsed answers what the sender asked, of the contract that he named."""
    del pins
    found = used(case)
    for place, why in found.items():
        transaction = case.transaction(place, why)
        with within(name_of_place(place)):
            check_proposal(transaction)
        if transaction.invocation.chaincode not in {case.bundle.chaincode, LIFECYCLE}:
            raise StepError(f"{name_of_place(place)} is of the contract {transaction.invocation.chaincode!r}")
    return f"{len(found)} transactions"


def check_endorsements(case: Case, pins: Pins) -> str:
    """8: each transaction was endorsed by peers of the channel, with signatures in the low-S form.

    Its sender may have added others, which hold for nobody: they count for nothing here, as at every peer.
    """
    del pins
    count = sum(len(endorsements_of(case, place)) for place in used(case))
    return f"{count} endorsements"


def check_endorsement_policy(case: Case, pins: Pins) -> str:
    """9: those who endorsed were those who had to, by the contract's definition and by the records' own policies."""
    del pins
    own = 0
    sequences = set()
    for place, why in used(case).items():
        signers = endorsements_of(case, place)
        transaction = case.transaction(place, why)
        trust = case.trust_before(place.block)
        if transaction.invocation.chaincode == LIFECYCLE:
            if not trust.holds_at(LIFECYCLE_POLICY, signers):
                raise StepError(
                    f"{name_of_place(place)}: the contract's definition lacks the agreement of enough organisations"
                )
            continue
        policies = [
            own_policy(case, place, key)[0] for key in keys_written(transaction.invocation, case.bundle.chaincode)
        ]
        for each in filter(None, policies):
            own += 1
            policy = parse_policy(each)
            if policy is None or not satisfied(policy, signers):
                raise StepError(f"{name_of_place(place)}: a record's own endorsement policy is not met")
        if None in policies or not policies:
            sequences.add(require_contract_policy(case, place, trust, signers))
    agreed = ", ".join(f"definition {each}" for each in sorted(sequences) if each)
    return f"{agreed or 'the channel’s policy Endorsement'}; {own} records with a policy of their own" + one_process(
        case
    )


def require_contract_policy(case: Case, place: Version, trust: ChannelTrust, signers: tuple[Signer, ...]) -> int:
    """The contract's policy is met; which definition's it is, 0 for the channel's own (an embedded ledger)."""
    if case.is_embedded:
        agreed, met = 0, trust.holds_at(CONTRACT_POLICY, signers)
    else:
        found = definition(case, place)
        agreed, met = found.sequence, policy_holds(trust, found.policy, signers)
    if not met:
        names = ", ".join(sorted({each.msp_id for each in signers})) or "nobody"
        raise StepError(
            f"{name_of_place(place)}: signed by {names}, which the contract's endorsement policy does not accept"
        )
    return agreed


def endorsements_of(case: Case, place: Version) -> tuple[Signer, ...]:
    """Who endorsed a transaction, by the signatures that hold. Raises `StepError` where none does."""
    transaction = case.transaction(place, "endorsements")
    trust, at_ms = case.trust_before(place.block), transaction.parsed.timestamp_ms
    found = counted_endorsers(trust, transaction.invocation, at_ms)
    if not found:
        with within(name_of_place(place)):
            endorsers(trust, transaction.invocation, at_ms)  # says why the first does not hold
        raise StepError(f"{name_of_place(place)}: endorsed by nobody")
    return found
