"""The model says what the code says: its names, texts and fields cannot drift from it unseen. Needs no ProVerif."""

import dataclasses
import re
from pathlib import Path

import pytest

from wonderland import telemetry
from wonderland.proofs import encoding, keys, statement, transcript
from wonderland.proofs.records.sessions import RangeTable
from wonderland.proofs.records.transactions import RequestProof, SubmitProof, WitnessProof
from wonderland.proofs.transcript import Transcript
from wonderland.uwb.link.messages import MessageType
from wonderland_chaincode.contract import CONTRACT
from wonderland_research.protocol import report
from wonderland_research.protocol.model import DIRECTORY, LEVELS, scenarios

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "protocol.md"
SOURCES = [
    path
    for top in ("libraries", "chaincode", "edge_agent", "uav_agent", "backend")
    for path in (ROOT / top).rglob("*.py")
]


def text(name):
    return (DIRECTORY / name).read_text()


def fields_of(name, constructor):
    """The names in the comments after a constructor's arguments, in their order."""
    body = re.search(rf"^fun {constructor}\((.*?)^\): bitstring", text(name), re.DOTALL | re.MULTILINE)[1]
    found = []
    for comment in re.findall(r"\(\* field (.*?) \*\)", body):
        found += [each.strip() for each in comment.split(":")[0].split(",")]
    return list(dict.fromkeys(found))


def said_of(name, constant):
    """The text in the comment of a constant."""
    return re.search(rf'\b{constant}: bitstring\. *\(\* text "(.*?)"', text(name))[1]


def test_each_label_of_the_key_schedule_is_the_codes(monkeypatch):
    used = []

    def expand(root, label, size):
        used.append(label.decode())
        return bytes(size)

    monkeypatch.setattr(keys, "_expand", expand)
    keys.derive(b"s" * 32, b"t" * 32)
    modelled = re.findall(r'^const (\w+): label\. *\(\* label "(.*?)" \*\)$', text("terms.pvl"), re.MULTILINE)
    assert sorted(used) == sorted(label for _, label in modelled)
    assert len(set(used)) == len(used), "two secrets of one label are the same secret"
    secrets = {field.name for field in dataclasses.fields(keys.SessionKeys)}
    assert {name for name, _ in modelled} - {"names"} <= secrets


def test_the_transcript_has_the_codes_fields():
    assert fields_of("terms.pvl", "transcript") == _grouped([field.name for field in dataclasses.fields(Transcript)])


def _grouped(names):
    """The model takes what names one party together, where the first of it stands."""
    groups = [("pad_id", "pad_msp", "pad_certificate_sha256"), ("uav_id", "uav_msp", "uav_certificate_sha256")]
    found = []
    for name in names:
        group = next((each for each in groups if name in each), (name,))
        found += [each for each in group if each not in found]
    return found


def test_the_statement_has_the_codes_fields():
    signed = statement.statement("0" * 64, "1" * 64, RangeTable(t_ms=(), anchors=()), (), ("AAAAAAAAAAA",))
    assert sorted(fields_of("terms.pvl", "statement")) == sorted(encoding.decode(signed))


def test_the_sign_in_has_the_codes_fields():
    signed = telemetry.signed_text(nonce="n", agent="pad", agent_id="p", spool="0" * 32, end_point="e")
    assert sorted(fields_of("sign_in.pvl", "signed_text")) == sorted(encoding.decode(signed))


def test_texts_that_keep_purposes_apart_are_the_codes():
    found = {
        "protocol": transcript.PROTOCOL,
        "suite": transcript.SUITE,
        "sts": transcript.STS,
        "countersignature": statement.PURPOSE,
    }
    assert {name: said_of("terms.pvl", name) for name in found} == found
    signed = encoding.decode(telemetry.signed_text(nonce="n", agent="pad", agent_id="p", spool="s", end_point="e"))
    assert (signed["purpose"], signed["server"]) == (
        said_of("sign_in.pvl", "sign_in"),
        said_of("sign_in.pvl", "server_name"),
    )
    assert said_of("sign_in.pvl", "no_end_point") == telemetry.NO_END_POINT
    assert said_of("sign_in.pvl", "sign_in") != statement.PURPOSE, "one key signs both"


def test_words_and_transactions_are_the_codes():
    words = set(re.findall(r"\(\* message (\w+) \*\)", text("terms.pvl")))
    # A verdict is a hint, and who aborts says nothing that anything rests on.
    assert words == {each.name for each in MessageType} - {"VERDICT", "ABORT"}
    transactions = set(re.findall(r"\(\* transaction (\w+) \*\)", text("terms.pvl")))
    assert transactions == {"PublishPrekeys", RequestProof.__name__, WitnessProof.__name__, SubmitProof.__name__}
    assert transactions <= set(CONTRACT.functions)


@pytest.mark.parametrize("name", sorted(path.name for path in DIRECTORY.iterdir()))
def test_every_place_of_the_code_that_the_model_names_is_there(name):
    for comment in re.findall(r"\(\*.*?\*\)", text(name), re.DOTALL):
        for path, names in re.findall(r"([\w/]+\.py)(?:: ([\w.]+(?:, [\w.]+)*))?", comment):
            found = [each for each in SOURCES if str(each).endswith(f"/{path}")]
            assert found, f"{name} names {path}"
            for wanted in filter(None, names.split(", ")):
                last = wanted.rsplit(".", 1)[-1]
                assert any(re.search(rf"\b{last}\b", each.read_text()) for each in found), (
                    f"{name} names {path}: {wanted}"
                )


def test_every_lemma_stands_in_the_docs_once_for_each_level():
    lemmas = [(scenario, lemma) for scenario in scenarios() for lemma in scenario.lemmas]
    names = [lemma.name for _, lemma in lemmas]
    assert len(set(names)) == len(names)
    rows = report.rows_of(report.tables_of(PAGE.read_text()))
    assert list(rows) == names
    for scenario, lemma in lemmas:
        assert len(rows[lemma.name]) == (len(LEVELS) if scenario.levels else 1), lemma.name
        assert lemma.says in PAGE.read_text(), lemma.name


def test_every_lemma_is_asked_of_a_model_that_does_something():
    rows = report.rows_of(report.tables_of(PAGE.read_text()))
    runs = {name: cells for name, cells in rows.items() if name.startswith("run_")}
    assert len(runs) > 5
    assert {cell for cells in runs.values() for cell in cells} == {"reached"}
    assert {cell for name, cells in rows.items() if name not in runs for cell in cells} <= {"holds", "attack"}


def test_each_level_of_assurance_has_the_attack_that_the_next_one_stops():
    rows = report.rows_of(report.tables_of(PAGE.read_text()))
    first_held = {
        "ranges_of_the_pad": 1,
        "place_outsider": 2,
        "place_uav": 3,
        "place_pad": 4,
        "place_pad_and_uav": 4,
    }
    for name, level in first_held.items():
        assert rows[name] == ("attack",) * level + ("holds",) * (len(LEVELS) - level), name
    assert set(rows["place_all"]) == {"attack"}


def test_a_file_with_an_unnamed_query_is_no_scenario(tmp_path):
    for path in DIRECTORY.iterdir():
        (tmp_path / path.name).write_text(path.read_text())
    later = tmp_path / "later.pv"
    later.write_text(later.read_text().replace("(* lemma keys_secret_uav_later", "(* keys_secret_uav_later"))
    with pytest.raises(ValueError, match=r"later\.pv"):
        scenarios(tmp_path)
