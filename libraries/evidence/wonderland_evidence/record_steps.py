"""Steps 10 to 13: what the transactions say. Records, signed answers on validity, time-stamps, the decision again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from wonderland.proofs import encoding
from wonderland.proofs.records import keys
from wonderland.proofs.records.pads import Pad
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.transactions import SubmitProof
from wonderland.proofs.records.verdicts import Verdict
from wonderland_evidence import timestamps
from wonderland_evidence.case import NO_VERDICT, QUERY, SESSION_FUNCTIONS, is_about
from wonderland_evidence.derive import value_at, version_read
from wonderland_evidence.errors import NotCheckedError, StepError
from wonderland_evidence.places import name_of_place, one_process, used, within
from wonderland_evidence.replay import installed_contract, run_again
from wonderland_evidence.transaction_steps import require_contract_policy
from wonderland_fabric_gateway.transactions import ValidationCode
from wonderland_fabric_gateway.verification.transaction_checks import endorsers, proposal_hash

if TYPE_CHECKING:
    from wonderland_evidence.case import Answer, Case
    from wonderland_evidence.trust import Pins
    from wonderland_fabric_gateway.transactions import Version

REQUEST: Final = "RequestProof"
SUBMIT: Final = "SubmitProof"
MAX_RECORD: Final = 8 << 20


def check_records(case: Case, pins: Pins) -> str:
    """10: request, evidence, survey and verdict belong to one another, and each read to the one write that it saw."""
    del pins
    session_id = case.bundle.session_id
    for place, function in case.session.items():
        invocation = case.transaction(place, function).invocation
        begins = function == REQUEST and case.transaction(place, function).parsed.tx_id == session_id
        continues = function in SESSION_FUNCTIONS and is_about(invocation, session_id)
        if invocation.chaincode != case.bundle.chaincode or not (begins or continues):
            raise StepError(f"transaction {name_of_place(place)} is none of session {session_id[:12]}…")
    request = case.of_session(REQUEST)
    if request is None:
        raise StepError("the session's RequestProof is not in the file")
    namespace, key = case.bundle.chaincode, keys.composite(keys.SESSION, session_id)
    session = Session.decode(value_at(case, request, namespace, key))
    _require_event(case, request, session.to_json())
    for place, function in case.session.items():
        _, before = version_read(case.transaction(place, function).invocation, namespace, key)
        if before is not None and before not in case.session:
            raise StepError(
                f"{function} read the session's record as {name_of_place(before)} wrote it, and no answer in the file "
                "is about that: it is left out"
            )
    submit = case.of_session(SUBMIT)
    if submit is None:
        return f"{len(used(case))} transactions; {'; '.join(case.lacks)}"
    invocation = case.transaction(submit, SUBMIT).invocation
    if version_read(invocation, namespace, key) != (True, request):
        raise StepError("the verdict rests on another request than the one in the file")
    verdict = verdict_of(case)
    _require_event(case, submit, verdict.to_json())
    evidence = SubmitProof.decode(invocation.args[1]).evidence
    if encoding.digest(evidence.to_json()).hex() != verdict.evidence_sha256 or verdict.session_id != session_id:
        raise StepError("the verdict names other evidence than the pad brought")
    _, surveyed = version_read(invocation, namespace, keys.composite(keys.PAD, session.pad_id))
    if surveyed is None:
        raise StepError("the verdict rests on no pad")
    pad = Pad.decode(
        value_at(case, surveyed, namespace, keys.composite(keys.PAD, session.pad_id)), max_bytes=MAX_RECORD
    )
    survey = pad.commissioning
    if survey is None or encoding.digest(survey.to_json()).hex() != session.commissioning_sha256:
        raise StepError("the pad's survey is another one than the request names")
    found = f"{len(used(case))} transactions; {verdict.outcome}, permission {verdict.permission}"
    return "; ".join((found, *case.lacks))


def check_validity(case: Case, pins: Pins) -> str:
    """11: peers of enough organisations signed that each transaction of the session is valid."""
    del pins
    newest = case.trusts[-1]
    organisations: set[str] = set()
    for answer in case.answers:
        place = case.places[answer.tx_id]
        transaction = case.transaction(place, "peers were asked about it")
        with within(name_of_place(place)):
            _require_answer(case, answer)
            signers = endorsers(newest, answer.invocation, answer.asked_ms)
        data = case.block(place.block, "peers were asked about it").data or ()
        if answer.processed.transactionEnvelope.SerializeToString() != data[place.transaction]:
            raise StepError(f"{name_of_place(place)}: the peers speak of another transaction of that id")
        if answer.processed.validationCode != ValidationCode.VALID:
            raise StepError(
                f"{name_of_place(place)}: the peers say that it is not valid ({answer.processed.validationCode})"
            )
        if transaction.parsed.tx_id != answer.tx_id:
            raise StepError(f"{name_of_place(place)}: the peers speak of {answer.tx_id[:16]}…")
        require_contract_policy(case, place, newest, signers)
        organisations |= {each.msp_id for each in signers}
    if not case.answers:
        raise StepError("no peer was asked")
    return f"{len(case.answers)} transactions, by {', '.join(sorted(organisations))}{one_process(case)}"


def check_timestamps(case: Case, pins: Pins) -> str:
    """12: a time-stamping service that is pinned says when a block was there already (RFC 3161)."""
    return timestamps.check(case, pins)


def check_decision(case: Case, pins: Pins) -> str:
    """13: the contract, run again on these records, decides the same to the last bit."""
    del pins
    submit, request = case.of_session(SUBMIT), case.of_session(REQUEST)
    if submit is None or request is None:
        raise NotCheckedError(NO_VERDICT)
    contract = installed_contract()
    session = Session.decode(
        value_at(case, request, case.bundle.chaincode, keys.composite(keys.SESSION, case.bundle.session_id))
    )
    if session.contract_version != contract.version:
        raise NotCheckedError(
            f"the session was judged by version {session.contract_version} of the contract; this verifier has "
            f"{contract.version}"
        )
    for place in case.session:
        with within(name_of_place(place)):
            run_again(case, place, contract)
    return f"contract {contract.version}: {verdict_of(case).outcome}, bit for bit"


def verdict_of(case: Case) -> Verdict:
    """The verdict that the session's SubmitProof wrote. Raises `StepError`."""
    submit = case.of_session(SUBMIT)
    if submit is None:
        raise StepError("the session has no verdict")
    key = keys.composite(keys.VERDICT, case.bundle.session_id)
    return Verdict.decode(value_at(case, submit, case.bundle.chaincode, key))


def _require_event(case: Case, place: Version, record: dict[str, Any]) -> None:
    """What everybody was told is what was written. Raises `StepError`."""
    transaction = case.transaction(place, "its event")
    event = transaction.invocation.event
    if event is None or encoding.decode(event.payload, max_bytes=8 << 20).get("record") != record:
        raise StepError(f"{name_of_place(place)}: its event tells something else than what it wrote")


def _require_answer(case: Case, answer: Answer) -> None:
    if answer.channel != case.bundle.channel or answer.chaincode != QUERY or answer.invocation.chaincode != QUERY:
        raise StepError("a validity answer of another channel, or of another contract than qscc")
    raw = answer.raw
    if proposal_hash(raw.channel_header, raw.signature_header, raw.proposal) != answer.invocation.proposal_hash:
        raise StepError("the answer belongs to another question")
