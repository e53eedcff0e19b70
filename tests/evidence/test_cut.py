"""A file can be cut, and anything in it doubled: what it lacks is said, and nothing counts twice. Both verifiers."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from kit.evidence import lines, run

from wonderland.proofs import encoding
from wonderland_evidence.bundle import Bundle
from wonderland_evidence.case import Case
from wonderland_evidence.errors import UnreadableError
from wonderland_evidence.trust import Pins
from wonderland_evidence.verify import verify

from .test_page import GOOD, TRUST, failing

NO_VERDICT = "this file has no verdict of the session"
NO_END = "this file does not say how the session ended"


def cut_from(function):
    """The good one up to the transaction before that function's, with the neighbour after it where there is one."""
    bundle = Bundle.decode(GOOD)
    case = Case(bundle)
    number = case.of_session(function).block
    kept = {answer.tx_id for answer in case.answers if case.places[answer.tx_id].block < number}
    answers = [raw for raw, read in zip(bundle.validity, case.answers, strict=True) if read.tx_id in kept]
    blocks = [each if each.number < number else each.without_data() for each in bundle.blocks if each.number <= number]
    return replace(bundle, blocks=tuple(blocks), validity=tuple(answers))


def told(tmp_path, data, trust=TRUST):
    files = tmp_path / "evidence.json", tmp_path / "trust.json"
    files[0].write_bytes(data)
    files[1].write_bytes(trust)
    result = run("verify", files[0], "--trust", files[1], "--json")
    return result.exit_code, lines(result)


def without_neighbour(bundle):
    return replace(bundle, blocks=bundle.blocks[:-1])


def test_without_its_verdict_a_file_says_that_it_has_none(tmp_path):
    for bundle in (cut_from("SubmitProof"), without_neighbour(cut_from("SubmitProof"))):
        code, found = told(tmp_path, bundle.encode())
        assert code == 4
        assert NO_VERDICT in found[9]["text"]
        assert NO_END in found[9]["text"]
        assert "The file has no verdict" in found[9]["proves"]
        assert "verdict belong together" not in found[9]["proves"]
        assert "nothing about this session was left out" in found[9]["does_not_prove"]
        assert (found[12]["status"], found[12]["text"]) == ("not_checked", NO_VERDICT)


def test_without_its_end_a_file_says_so(tmp_path):
    _, found = told(tmp_path, cut_from("CompleteInteraction").encode())
    assert NO_END in found[9]["text"]
    assert NO_VERDICT not in found[9]["text"]
    assert {each["status"] for each in found[:11]} == {"holds"}
    _, whole = told(tmp_path, GOOD)
    assert "this file" not in whole[9]["text"]


def test_what_is_cut_from_the_middle_is_missed(tmp_path):
    bundle = Bundle.decode(GOOD)
    case = Case(bundle)
    submit = case.transaction(case.of_session("SubmitProof"), "").parsed.tx_id
    answers = [raw for raw, read in zip(bundle.validity, case.answers, strict=True) if read.tx_id != submit]
    code, found = told(tmp_path, replace(bundle, validity=tuple(answers)).encode())
    assert (code, found[9]["status"], "it is left out" in found[9]["text"]) == (1, "fails", True)


def test_no_block_is_called_the_newest_and_missing_ones_are_named(tmp_path):
    _, found = told(tmp_path, without_neighbour(Bundle.decode(GOOD)).encode())
    assert "nothing in it shows what came after" in found[1]["text"]
    numbers = {each.number for each in Bundle.decode(GOOD).blocks}
    missing = sorted(set(range(max(numbers))) - numbers)
    assert ("blocks not in the file: " in found[1]["text"]) == bool(missing)
    assert not missing or f"blocks not in the file: {missing[0]}" in found[1]["text"]


def doubled():
    """Each list of which an element can stand twice, so that it does."""

    def changed(change):
        document = json.loads(GOOD)
        change(document)
        return encoding.encode(document)

    def double(items):
        items.append(items[0])

    return {
        "answer": changed(lambda found: double(found["validity"])),
        "endorsement": changed(lambda found: double(found["validity"][0]["endorsements"])),
        "20,000 endorsements": changed(
            lambda found: found["validity"][0]["endorsements"].extend(found["validity"][0]["endorsements"][:1] * 20_000)
        ),
        "orderer": changed(lambda found: double(found["blocks"][-1]["orderers"]["signatures"])),
        "time-stamp": changed(lambda found: found["timestamps"].extend([{"block": 1, "token": "AAAA"}] * 2)),
        "17 time-stamps": changed(
            lambda found: found["timestamps"].extend({"block": each, "token": "AAAA"} for each in range(17))
        ),
    }


@pytest.mark.parametrize("name", doubled())
def test_what_stands_twice_is_refused(tmp_path, name):
    code, found = told(tmp_path, doubled()[name])
    assert (code, found[0]["step"]) == (3, 0)


def untrue():
    """Trust files whose texts are not those of the certificates beside them."""
    for name, value in (("subject", "CN=somebody"), ("valid_from", "2000-01-01"), ("valid_until", "never")):
        document = json.loads(TRUST)
        document["organisations"]["PadMSP"]["roots"][0][name] = value
        yield name, json.dumps(document).encode()


def test_texts_of_the_trust_file_are_those_of_its_certificates():
    for name, data in untrue():
        with pytest.raises(UnreadableError, match=f"{name} is not that of the certificate") as told:
            Pins.decode(data)
        assert told.value.code == "wrong_field"


def test_a_changed_channel_is_named():
    found = verify(replace(Bundle.decode(GOOD), channel="elsewhere").encode(), Pins.decode(TRUST)).failed
    assert (found.number, "'elsewhere' in the file" in found.text) == (1, True)


@pytest.mark.browser
@pytest.mark.timeout(300)
def test_the_page_says_the_same(shown_in):
    statuses, line = shown_in(cut_from("SubmitProof").encode(), TRUST)
    assert statuses == ["holds"] * 11 + ["not_checked"] * 2
    assert line.startswith("There is no verdict to check. This file has no verdict of the session")
    assert "All steps hold" not in line
    _, line = shown_in(cut_from("CompleteInteraction").encode(), TRUST)
    assert "This file does not say how the session ended" in line
    bundle = Bundle.decode(GOOD)
    middle = replace(bundle, validity=bundle.validity[:1] + bundle.validity[2:])
    assert failing(shown_in(middle.encode(), TRUST)[0]) == 10
    for name, data in doubled().items():
        statuses, line = shown_in(data, TRUST)
        assert (statuses, "cannot be read" in line) == ([], True), name
    for name, data in untrue():
        statuses, line = shown_in(GOOD, data)
        assert (statuses, f"{name} is not that of the certificate" in line) == ([], True), name
