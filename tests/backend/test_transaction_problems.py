"""Why a transaction did nothing, from its validation code: what a page says of it."""

from __future__ import annotations

import pytest

from wonderland_backend.transactions.problems import of_outcome
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
    assert problem == {"kind": kind, "text": f"{code.name} in block 7"}
