"""Writes ``evidence/``: a bundle, its trust file, and changes of it that a verifier must find.

Run by ``make evidence-vectors``. Every run makes a new ledger with new keys, so that all bytes change: run it only when
the format does.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from kit.evidence import exhibit, patched
from kit.scenario_world import PLACES

from wonderland_evidence.case import Case
from wonderland_evidence.places import used

TARGET = Path(__file__).parent / "evidence"


def changes(case):
    """Name → a JSON patch (RFC 6902) of the good bundle, and the step that finds it."""
    at = {block.number: index for index, block in enumerate(case.bundle.blocks)}
    request, submit = (at[case.of_session(name).block] for name in ("RequestProof", "SubmitProof"))
    configuration = at[case.trusts[1].number]
    other = "A" * 43
    survey = next(at[place.block] for place, why in used(case).items() if why.startswith("commissioning"))
    return {
        "another first block": (1, [("replace", "/blocks/0/data_hash", other)]),
        "another previous hash": (2, [("replace", f"/blocks/{submit}/previous_hash", other)]),
        "another transaction": (3, [("replace", f"/blocks/{survey}/data/0", other)]),
        "a configuration left out": (4, [("remove", f"/blocks/{configuration}", None)]),
        "another block's signature": (
            4,
            [("copy", f"/blocks/{submit}/orderers/signatures", f"/blocks/{request}/orderers/signatures")],
        ),
        "no signature of an orderer": (5, [("replace", f"/blocks/{submit}/orderers/signatures", [])]),
        "another session": (10, [("replace", "/session_id", "0" * 64)]),
        "the answer of one organisation": (
            11,
            [("remove", "/validity/0/endorsements/2", None), ("remove", "/validity/0/endorsements/1", None)],
        ),
        "the answer to another question": (11, [("copy", "/validity/0/response", "/validity/1/response")]),
        "another peer's signature": (
            11,
            [("copy", "/validity/0/endorsements/0/signature", "/validity/1/endorsements/0/signature")],
        ),
    }


def operation(kind, path, value):
    """One of RFC 6902."""
    found = {"op": kind, "path": path}
    return found | ({"from": value} if kind == "copy" else {} if kind == "remove" else {"value": value})


def main() -> None:
    """A session on an embedded ledger, and what a verifier must find in it."""
    with tempfile.TemporaryDirectory() as directory:
        place = PLACES["embedded"](Path(directory))
        place.start()
        try:
            shown = exhibit(place, Path(directory))
        finally:
            place.stop()
    vectors = []
    for name, (step, operations) in changes(Case(shown.bundle)).items():
        patch = [operation(*each) for each in operations]
        found = shown.report(patched(shown.data, patch)).failed
        assert found is not None, name
        assert found.number == step, (name, found)
        vectors.append({"name": name, "fails": step, "patch": patch})
    TARGET.mkdir(exist_ok=True)
    (TARGET / "good.json").write_bytes(shown.data)
    (TARGET / "trust.json").write_bytes(shown.trust)
    (TARGET / "changes.json").write_text(json.dumps(vectors, indent=1) + "\n")


if __name__ == "__main__":
    main()
