"""Evidence from each ledger holds, in every step, without the ledger."""

import asyncio
import json
import socket
import subprocess
import sys

import pytest
from kit.evidence import lines, played, run

from wonderland_evidence.case import Case
from wonderland_evidence.places import used
from wonderland_evidence.steps import STEPS

pytestmark = pytest.mark.timeout(300)


def test_every_step_holds(shown):
    report = shown.report()
    assert report.failed is None, report.failed
    assert report.is_whole
    assert [each.number for each in report.findings] == list(range(1, 14))
    status = {each.step.name: each.status for each in report.findings}
    assert status.pop("time-stamp") == "not_checked"
    assert set(status.values()) == {"holds"}
    assert report.findings[0].text.startswith("channel wonderland, 2 configurations")


def test_the_file_is_the_same_however_often_it_is_read_and_written(shown):
    assert shown.bundle.encode() == shown.data


def test_what_the_verdict_rests_on_is_there_with_the_survey_and_the_policy(shown):
    case = Case(shown.bundle)
    functions = {case.transaction(place, "").invocation.function for place in used(case)}
    common = {"RequestProof", "SubmitProof", "CompleteInteraction", "CommissionPad", "UpdatePad", "ApproveChange"}
    assert common | {"PublishPrekeys", "RecordMaintenance", "GrantAuthorisation", "RegisterPad"} <= functions
    assert ("CommitChaincodeDefinition" in functions) == (shown.kind == "fabric")


def test_a_ledger_whose_keys_are_in_one_hand_is_called_so(shown):
    text = " ".join(each.text for each in shown.report().findings)
    assert ("one process holds the keys of all" in text) == (shown.kind == "embedded")


def test_each_step_says_what_it_proves_and_what_not():
    assert len({step.proves for step in STEPS}) == len({step.does_not_prove for step in STEPS}) == len(STEPS) == 13


def test_the_command_prints_a_step_a_line_and_ends_with_0(shown, tmp_path):
    files = tmp_path / "evidence.json", tmp_path / "trust.json"
    files[0].write_bytes(shown.data)
    files[1].write_bytes(shown.trust)
    told = run("verify", files[0], "--trust", files[1], "--json")
    assert told.exit_code == 0
    assert [(each["step"], each["name"]) for each in lines(told)] == [
        (number, step.name) for number, step in enumerate(STEPS, 1)
    ]
    assert all(each["does_not_prove"] for each in lines(told))
    assert all(bool(each["proves"]) is (each["status"] == "holds") for each in lines(told))
    assert {each["status"] for each in lines(told)} == {"holds", "not_checked"}
    shown_to_people = run("verify", files[0], "--trust", files[1])
    assert shown_to_people.exit_code == 0
    assert "13 decision: contract 1.0: verified, bit for bit" in shown_to_people.output


def test_a_verifier_needs_no_grpc(small, tmp_path):
    files = tmp_path / "evidence.json", tmp_path / "trust.json"
    files[0].write_bytes(small.data)
    files[1].write_bytes(small.trust)
    program = (
        "import socket, sys; sys.modules['grpc'] = socket.socket.connect = None\n"
        "from wonderland_evidence.commands import evidence\n"
        f"evidence(['verify', {str(files[0])!r}, '--trust', {str(files[1])!r}])\n"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60)
    assert told.returncode == 0, told.stderr[-2000:]


def test_another_version_of_the_contract_is_said_and_never_holds(small, tmp_path, monkeypatch):
    from wonderland_chaincode.contract import CONTRACT

    monkeypatch.setattr(type(CONTRACT), "version", "2.0")
    report = small.report()
    assert report.failed is None
    assert not report.is_whole
    last = report.findings[-1]
    assert (last.status, "version 1.0" in last.text, "has 2.0" in last.text) == ("not_checked", True, True)
    files = tmp_path / "evidence.json", tmp_path / "trust.json"
    files[0].write_bytes(small.data)
    files[1].write_bytes(small.trust)
    assert run("verify", files[0], "--trust", files[1]).exit_code == 4


def test_the_trust_file_is_for_people_to_read(shown):
    document = json.loads(shown.trust)
    assert shown.trust.count(b"\n") > 20
    assert document["channel"] == "wonderland"
    assert {"AuthorityMSP", "PadMSP", "FleetMSP", "OrdererMSP"} <= set(document["organisations"])
    for organisation in document["organisations"].values():
        for root in organisation["roots"]:
            assert root["pem"].startswith("-----BEGIN CERTIFICATE-----")
            assert root["subject"]


def test_a_session_that_is_not_there_is_an_error_in_words(shown, tmp_path):
    arguments = ("--connection", shown.place.connection_file, "--session", "0" * 64, "--out", tmp_path / "x")
    told = run("export", *arguments)
    assert told.exit_code == 1
    assert "the ledger knows no session 0000" in told.output
    assert not (tmp_path / "x").exists()


def test_a_ledger_that_cannot_be_reached_is_no_finding(small, tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    there = small.place.connection_file
    document = json.loads(there.read_text())
    document["gateway"]["address"] = address
    document.pop("gateways", None)
    elsewhere = there.with_name("unreached.json")
    elsewhere.write_text(json.dumps(document))
    told = run("export", "--connection", elsewhere, "--session", small.session_id, "--out", tmp_path / "x")
    assert told.exit_code == 5, told.output
    assert "could not be reached" in told.output
    assert "clock" in told.output
    assert "knows no session" not in told.output


def of_another(place, tmp_path, tag, story):
    """Exit code of the verification, and its lines, of one more session: what ``story(site, session)`` makes of it."""
    session_id = asyncio.run(played(place, tag, story))
    files = tmp_path / "evidence.json", tmp_path / "trust.json"
    for arguments in (("export", "--session", session_id, "--out", files[0]), ("trust", "--out", files[1])):
        assert run(*arguments, "--connection", place.connection_file).exit_code == 0
    told = run("verify", files[0], "--trust", files[1], "--json")
    return told.exit_code, lines(told)


async def refuted(site, session):
    await site.judge(session, truth=(50_000, 1_000, 1_500))
    await site.pad.submit("CancelProof", session_id=session["session_id"], reason="refused")


async def given_up(site, session):
    await site.pad.submit("CancelProof", session_id=session["session_id"], reason="timeout")


def test_a_refuted_session_is_proved_as_well(shown, tmp_path):
    code, found = of_another(shown.place, tmp_path, "e2", refuted)
    assert (code, found[-1]["text"]) == (0, "contract 1.0: refuted, bit for bit")


def test_a_session_without_a_verdict_proves_none(small, tmp_path):
    code, found = of_another(small.place, tmp_path, "e3", given_up)
    assert (code, found[-1]["status"]) == (4, "not_checked")
    assert "no verdict" in found[-1]["text"]
    assert {each["status"] for each in found[:11]} == {"holds"}
