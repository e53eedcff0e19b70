"""Why a transaction did nothing, from its validation code: what a page says of it."""

from __future__ import annotations

import pytest

from wonderland_backend.transactions.problems import changed, in_words, of_outcome
from wonderland_fabric_gateway.gateway import CommitStatus
from wonderland_fabric_gateway.transactions import ValidationCode


@pytest.mark.parametrize(
    ("code", "kind"),
    [
        (ValidationCode.ENDORSEMENT_POLICY_FAILURE, "policy"),
        (ValidationCode.MVCC_READ_CONFLICT, "changed"),
        (ValidationCode.PHANTOM_READ_CONFLICT, "changed"),
        (ValidationCode.BAD_PAYLOAD, "invalid"),
    ],
)
def test_validation_codes(code, kind):
    problem = of_outcome(CommitStatus("0" * 64, code, 7))
    assert in_words(problem, "en") == {"kind": kind, "text": f"{code.name} in block 7"}
    assert in_words(problem, "fi")["text"] == f"{code.name} lohkossa 7"


def test_what_was_changed_meanwhile():
    text = in_words(changed((-1, -1), (9, 0)), "en")["text"]
    assert text == "When you began, nothing was there; now it was changed in block 9. Nothing was written."
    assert "lohkossa 0;" in in_words(changed((0, 1), None), "fi")["text"]
    assert in_words({"kind": "refused", "text": "the contract's own words"}, "fi")["text"] == "the contract's own words"
