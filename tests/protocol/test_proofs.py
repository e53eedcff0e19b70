"""ProVerif finds what the docs say, and finds an attack where the model is weakened. Skips where it was not built."""

import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from wonderland_research.protocol import report
from wonderland_research.protocol.command import protocol
from wonderland_research.protocol.model import DIRECTORY, scenarios
from wonderland_research.protocol.prover import ProverError, binary, prove

PAGE = Path(__file__).resolve().parents[2] / "docs" / "protocol.md"
ALL = {scenario.name: scenario for scenario in scenarios()}
RUNS = [(name, level) for name, scenario in ALL.items() for level in (scenario.levels or (None,))]


@pytest.fixture(scope="module")
def proverif():
    try:
        return binary()
    except ProverError as error:
        pytest.skip(str(error))


@pytest.mark.timeout(600)
@pytest.mark.parametrize(("name", "level"), RUNS)
def test_the_docs_say_what_is_found(proverif, name, level):
    rows = report.rows_of(report.tables_of(PAGE.read_text()))
    column = ALL[name].levels.index(level) if level is not None else 0
    documented = {lemma.name: rows[lemma.name][column] for lemma in ALL[name].lemmas}
    assert prove(proverif, ALL[name], level).outcomes == documented


WEAKER = [
    # (what is taken away, file, text, its replacement, lemma that must fall, at level)
    ("the transcript in the countersignature", "exchange.pvl", "statement(countersignature, id, digest,", "statement(countersignature, id, nothing,", "countersigned_node", 2),
    ("the session in the countersignature", "exchange.pvl", "statement(countersignature, id, digest,", "statement(countersignature, nothing, nothing,", "countersigned_pad_key", 2),
    ("the ranges in the countersignature", "exchange.pvl", "statement(countersignature, id, digest, measured,", "statement(countersignature, id, digest, claimed,", "countersigned_pad_key", 2),
    ("the transcript in the keys", "exchange.pvl", "hkdf(digest,", "hkdf(nothing,", "agreement_uav_sessions", 2),
    ("the sender's signature of prekeys", "exchange.pvl", "= checked(published, pad) in", "= message_of(published) in", "keys_secret_uav", 2),
    ("the sender's signature of requests", "exchange.pvl", "= checked(requested, uav) in", "= message_of(requested) in", "keys_secret_pad", 2),
    ("the signed list of broadcasts", "exchange.pvl", "if list = sha256(heard) then", "if list = list then", "broadcast_outsider", 2),
    ("the session's key in the ranging sequence", "level_2.pvl", "= keyed(key, round).", "= in_clear(round).", "place_outsider", 2),
    ("the one antenna of a frame", "level_3.pvl", "event RadioAt(key, there); insert stamps(key, answer, there)", "in(net, told: place); event RadioAt(key, there); insert stamps(key, answer, told)", "place_uav", 3),
    ("the witness's signature", "level_4.pvl", "= checked(testified, witness) in", "= message_of(testified) in", "place_pad", 4),
    ("the server's certificate in the sign-in", "sign_in.pvl", "fun certificate(vkey): bitstring [data].", "letfun certificate(who: vkey) = no_end_point.", "sign_in_tls", None),
    ("the server in the signed handshake", "sign_in.pvl", "let (=tls_client, =theirs, =exp(g, b), =vk(own)) = checked(signed, agent) in", "let (=tls_client, x: point, y: point, z: vkey) = checked(signed, agent) in", "sign_in_mutual", None),
]  # fmt: skip


@pytest.mark.timeout(600)
@pytest.mark.parametrize(("what", "file", "text", "weaker", "lemma", "level"), WEAKER, ids=[each[0] for each in WEAKER])
def test_what_is_taken_away_is_missed(proverif, tmp_path, what, file, text, weaker, lemma, level):
    directory = tmp_path / "model"
    shutil.copytree(DIRECTORY, directory)
    source = (directory / file).read_text()
    assert text in source
    (directory / file).write_text(source.replace(text, weaker))
    scenario = next(each for each in scenarios(directory) if lemma in {one.name for one in each.lemmas})
    alone = scenario.only(frozenset((lemma,)))
    assert prove(proverif, alone, level).outcomes == {lemma: "holds"}
    assert prove(proverif, alone, level, directory=directory).outcomes == {lemma: "attack"}, what


@pytest.mark.timeout(600)
def test_the_command_asks_one_lemma_and_shows_the_attack(proverif):
    done = CliRunner().invoke(protocol, ["--lemma", "place_uav", "--level", "2", "--trace"])
    assert done.exit_code == 0, done.output
    assert "| `place_uav` |" in done.output
    assert "**attack**" in done.output
    assert "RESULT" in done.output


def test_without_proverif_the_command_says_how_to_come_by_it(monkeypatch):
    monkeypatch.delenv("PROVERIF_BIN", raising=False)
    done = CliRunner().invoke(protocol, ["--lemma", "place_uav"])
    assert done.exit_code == 1
    assert "docs/protocol.md" in done.output


def test_the_command_refuses_what_it_does_not_have():
    assert "there is no flies" in CliRunner().invoke(protocol, ["--lemma", "flies"]).output
    assert "--page" in CliRunner().invoke(protocol, ["--page", str(PAGE), "--level", "2"]).output
    assert "--write" in CliRunner().invoke(protocol, ["--write"]).output


def test_a_program_that_is_no_proverif_is_told_from_one(monkeypatch, tmp_path):
    program = tmp_path / "proverif"
    program.write_text("#!/bin/sh\necho RESULT nothing is true.\n")
    monkeypatch.setenv("PROVERIF_BIN", str(program))
    with pytest.raises(ProverError, match="no program"):
        binary()
    program.chmod(0o700)
    with pytest.raises(ProverError, match="1 of 2 answers"):
        prove(binary(), ALL["later"], 2)
