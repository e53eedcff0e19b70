"""Whatever is done to a bundle is found, by the step that is there for it."""

from __future__ import annotations

import hashlib
import os
import random
from dataclasses import replace

import pytest
from fabric_protos.common import common_pb2
from fabric_protos.peer import proposal_pb2, proposal_response_pb2, transaction_pb2
from kit.evidence import with_block
from kit.forgers import other_outcome, without_endorsements

from wonderland.proofs.records import keys
from wonderland_evidence.bundle import Bundle, BundleBlock, OrdererSignature
from wonderland_evidence.case import Case
from wonderland_evidence.derive import version_read
from wonderland_evidence.errors import UnreadableError
from wonderland_evidence.places import used
from wonderland_evidence.verify import verify
from wonderland_fabric_gateway.blocks import BlockHeader, data_hash
from wonderland_fabric_gateway.identity import Identity

pytestmark = pytest.mark.timeout(300)
ALPHABET = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_"
EVERY = os.environ.get("EVIDENCE_BYTES", "") == "all"
SAMPLE = 250


def changed(data, at, rng):
    """Another byte there: one that base64url has, where one stood, so that the change gets past the reading."""
    made = bytearray(data)
    made[at] = rng.choice([each for each in ALPHABET if each != data[at]]) if data[at] in ALPHABET else data[at] ^ 1
    return bytes(made)


def positions(data, rng):
    if EVERY:
        return range(len(data))
    return sorted(rng.sample(range(len(data)), SAMPLE))


@pytest.mark.timeout(4 * 3600 if EVERY else 300)
def test_one_changed_byte_is_found_wherever_it_is(shown):
    rng = random.Random(7)
    missed = []
    for at in positions(shown.data, rng):
        try:
            report = shown.report(changed(shown.data, at, rng))
        except UnreadableError:
            continue
        if report.failed is None:
            missed.append((at, shown.data[at - 40 : at + 10]))
    assert not missed


def session_block(shown, function):
    return Case(shown.bundle).of_session(function)


# --- what nobody signs in a block: validity


def with_answer(bundle, index, **change):
    answers = list(bundle.validity)
    answers[index] = replace(answers[index], **change)
    return replace(bundle, validity=tuple(answers))


def test_a_flipped_validity_flag_is_found(shown):
    response = proposal_response_pb2.ProposalResponsePayload.FromString(shown.bundle.validity[1].response)
    action = proposal_pb2.ChaincodeAction.FromString(response.extension)
    processed = transaction_pb2.ProcessedTransaction.FromString(action.response.payload)
    assert processed.validationCode == 0
    processed.validationCode = 11
    action.response.payload = processed.SerializeToString()
    response.extension = action.SerializeToString()
    number, text = shown.failing(with_answer(shown.bundle, 1, response=response.SerializeToString()))
    assert (number, "MVCC_READ_CONFLICT" in text or "signature" in text) == (11, True)


def test_an_answer_about_another_transaction_does_not_serve(shown):
    first, second, *_ = shown.bundle.validity
    number, text = shown.failing(
        with_answer(shown.bundle, 0, response=second.response, endorsements=second.endorsements)
    )
    assert (number, "another question" in text) == (11, True)
    assert first.response != second.response


def test_answers_of_too_few_organisations_do_not_suffice(shown):
    answer = shown.bundle.validity[0]
    assert len({Identity.from_creator(who).msp_id for who, _ in answer.endorsements}) >= 2
    number, text = shown.failing(with_answer(shown.bundle, 0, endorsements=answer.endorsements[:1]))
    assert (number, "does not accept" in text) == (11, True)
    assert shown.failing(replace(shown.bundle, validity=()))[0] in {10, 11}


def test_a_verdict_without_peers_that_call_it_valid_is_no_verdict(shown):
    submit = shown.bundle.validity[:1] + shown.bundle.validity[2:]
    number, text = shown.failing(replace(shown.bundle, validity=submit))
    assert (number, "it is left out" in text) == (10, True)


# --- signatures, certificates, neighbours


def test_a_removed_signature_of_an_orderer_is_missed(shown):
    place = session_block(shown, "SubmitProof")
    number, text = shown.failing(with_block(shown.bundle, place.block, signatures=()))
    assert (number, f"block {place.block}" in text) == (5, True)


def test_a_removed_endorsement_is_missed(shown):
    """Whoever leaves one out changes the block's bytes, and with them its hash."""
    assert shown.failing(change_transaction(shown, "SubmitProof", without_endorsements))[0] == 3


def test_swapped_neighbours_are_found(shown):
    place = session_block(shown, "SubmitProof")
    blocks = {each.number: each for each in shown.bundle.blocks}
    before, after = blocks[place.block - 1], blocks[place.block + 1]
    swapped = {
        before.number: replace(after, header=replace(after.header, number=before.number)),
        after.number: replace(before, header=replace(before.header, number=after.number)),
    }
    bundle = replace(shown.bundle, blocks=tuple(swapped.get(each.number, each) for each in shown.bundle.blocks))
    assert shown.failing(bundle)[0] == 2


def test_a_missing_neighbour_is_missed(shown):
    first, last = session_block(shown, "RequestProof").block, session_block(shown, "CompleteInteraction").block
    for number in (first - 1, last + 1):
        left = tuple(each for each in shown.bundle.blocks if each.number != number)
        step, text = shown.failing(replace(shown.bundle, blocks=left)) or (0, "")
        # The channel's end cannot be told from an end that was cut off there.
        assert (step, f"block {number}" in text) == ((2, True) if number < first else (0, False))


def test_a_configuration_that_is_left_out_is_missed(shown):
    """The second one revokes somebody: without it a revoked certificate would pass."""
    second = Case(shown.bundle).trusts[1].number
    assert Case(shown.bundle).trusts[1].config.sequence == Case(shown.bundle).trusts[0].config.sequence + 1
    left = tuple(each for each in shown.bundle.blocks if each.number != second)
    number, text = shown.failing(replace(shown.bundle, blocks=left))
    assert (number, "left out" in text or "missing" in text) == (4, True), text


def test_every_block_that_the_verdict_rests_on_is_missed(shown):
    case = Case(shown.bundle)
    for place in used(case):
        left = tuple(each for each in shown.bundle.blocks if each.number != place.block)
        assert shown.failing(replace(shown.bundle, blocks=left)) is not None, place


def test_another_channels_roots_are_no_trust(shown, exhibits):
    other = exhibits("embedded").pins
    pins = replace(shown.pins, roots={**shown.pins.roots, "PadMSP": frozenset({"0" * 64})})
    finding = verify(shown.data, pins).failed
    assert (finding.number, "root certificate of PadMSP is not pinned" in finding.text) == (1, True)
    if shown.kind != "embedded":
        assert verify(shown.data, other).failed.number == 1


# --- the forger: every checksum and hash made anew, and his own keys where keys are needed


def change_transaction(shown, function, change):
    """The bundle with that transaction changed by `change(envelope)`, and nothing else."""
    place = session_block(shown, function)
    block = next(each for each in shown.bundle.blocks if each.number == place.block)
    envelope = common_pb2.Envelope.FromString(block.data[place.transaction])
    change(envelope)
    data = list(block.data)
    data[place.transaction] = envelope.SerializeToString()
    return with_block(shown.bundle, place.block, data=tuple(data))


def rebuilt(bundle, sign):
    """All data hashes, links and orderers' signatures of a bundle made anew with the forger's key."""
    blocks, before = [], None
    for block in bundle.blocks:
        new_data = data_hash(block.data) if block.data is not None else block.header.data_hash
        previous = block.header.previous_hash
        if before is not None and before.number == block.number - 1:
            previous = before.header.hash
        header = BlockHeader(block.number, previous, new_data)
        signatures = ()
        if block.number:
            signed = common_pb2.SignatureHeader(creator=sign.creator, nonce=b"n" * 24).SerializeToString()
            signature = sign.sign(block.value + signed + header.der)
            signatures = (OrdererSignature(signed, signature, by_number=False),)
        before = BundleBlock(header, block.data, block.value, signatures)
        blocks.append(before)
    return replace(bundle, blocks=tuple(blocks))


def test_a_forger_who_recomputes_every_hash_still_lacks_the_orderers_keys(shown, thief):
    forged = change_transaction(shown, "SubmitProof", other_outcome)
    assert shown.failing(forged)[0] == 3
    number, text = shown.failing(rebuilt(forged, thief))
    assert (number, "was not issued by a CA of that organisation" in text) == (4, True)


def test_a_forger_with_an_orderers_key_still_lacks_the_peers(shown, inside):
    """The worst insider of the ordering service: he can leave out, and cannot invent."""
    assert shown.failing(rebuilt(shown.bundle, inside)) is None  # he may sign what is true
    number, text = shown.failing(rebuilt(change_transaction(shown, "SubmitProof", other_outcome), inside))
    assert (number, "signature" in text) == (6, True)
    number, _ = shown.failing(rebuilt(change_transaction(shown, "SubmitProof", without_endorsements), inside))
    assert number == 6


def test_a_forger_with_the_pads_key_too_still_lacks_the_peers(shown, inside, pad):
    def sign_again(envelope):
        other_outcome(envelope)
        envelope.signature = pad(envelope.payload)

    number, text = shown.failing(rebuilt(change_transaction(shown, "SubmitProof", sign_again), inside))
    assert (number, "an endorsement of" in text) == (8, True)

    def fewer(envelope):
        without_endorsements(envelope)
        envelope.signature = pad(envelope.payload)

    number, _ = shown.failing(rebuilt(change_transaction(shown, "SubmitProof", fewer), inside))
    assert number == 9


def test_an_older_survey_in_place_of_the_newest_is_found(shown, inside):
    """With the orderer's key in hand the forger puts the transaction of the first survey where the newest one was."""
    case = Case(shown.bundle)
    key = keys.composite(keys.PAD, "pad-e1")
    places = [case.of_session("SubmitProof")]
    for _ in range(3):
        invocation = case.transaction(places[-1], "").invocation
        places.append(version_read(invocation, shown.bundle.chaincode, key)[1])
    functions = [case.transaction(each, "").invocation.function for each in places]
    assert functions == ["SubmitProof", "UpdatePad", "CommissionPad", "CommissionPad"]
    blocks = {each.number: each for each in shown.bundle.blocks}
    old = with_block(shown.bundle, places[1].block, data=blocks[places[3].block].data)
    assert shown.failing(old)[0] == 3
    number, text = shown.failing(rebuilt(old, inside))
    assert (number, "survey is another one" in text) == (10, True)


def test_reading_stops_at_the_first_step_that_fails(shown):
    place = session_block(shown, "SubmitProof")
    report = shown.report(with_block(shown.bundle, place.block, signatures=()).encode())
    assert [each.status for each in report.findings] == ["holds"] * 4 + ["fails"] + ["not_checked"] * 8
    assert hashlib.sha256(Bundle.decode(shown.data).encode()).digest() == hashlib.sha256(shown.data).digest()
