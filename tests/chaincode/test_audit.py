"""Heads of audit logs: numbered, growing, each under the name of who anchored it."""

from __future__ import annotations

import pytest


def head(seq, **more):
    return {"log": "turku", "seq": seq, "sha256": f"{seq:064x}"} | more


def heads(ledger, who="mira", **more):
    return ledger.call(ledger.pad, "ListAuditHeads", anchored_by=who, **more)["heads"]


def test_heads_are_numbered_and_never_change(empty):
    kept = []
    for seq in (3, 4, 90):
        empty.now_ms += 10
        kept.append(empty.call(empty.mirror, "AnchorAuditLog", head(seq)))
    assert [(each["number"], each["seq"], each["anchored_by"]) for each in kept] == [
        (1, 3, "mira"),
        (2, 4, "mira"),
        (3, 90, "mira"),
    ]
    assert heads(empty) == kept
    assert heads(empty, after=1, limit=1) == kept[1:2]
    assert heads(empty, after=3) == []


@pytest.mark.parametrize("seq", [1, 5])
def test_a_log_that_was_cut_or_begun_anew_is_refused(empty, seq):
    empty.call(empty.mirror, "AnchorAuditLog", head(5))
    empty.refuse(422, "AUDIT_LOG_SHORTER", empty.mirror, "AnchorAuditLog", head(seq))


def test_one_name_has_one_log(empty):
    """Else a database put in the other's place would be anchored by the server itself, in good faith."""
    empty.call(empty.mirror, "AnchorAuditLog", head(5))
    empty.refuse(422, "AUDIT_LOG_OTHER", empty.mirror, "AnchorAuditLog", head(6, log="another"))
    empty.call(empty.mirror, "AnchorAuditLog", head(6))


def test_a_head_is_never_dated_back(empty):
    empty.call(empty.mirror, "AnchorAuditLog", head(5))
    empty.now_ms -= 1
    empty.refuse(422, "AUDIT_HEAD_EARLIER", empty.mirror, "AnchorAuditLog", head(6))


def test_nobody_gets_in_the_way_of_somebody_elses_log(empty):
    """With assets, whoever made tomorrow's first ended the anchoring."""
    for who in (empty.admin, empty.inspector, empty.pad, empty.uav, empty.operator, empty.fleet):
        empty.refuse(403, "ROLE_NOT_ALLOWED", who, "AnchorAuditLog", head(9_000))
    stranger = empty.person(empty.mirror, msp_id="FleetMSP")
    empty.refuse(403, "ROLE_OF_OTHER_ORGANISATION", stranger, "AnchorAuditLog", head(9_000))
    other = empty.person(empty.mirror, common_name="mona")
    empty.call(other, "AnchorAuditLog", head(9_000))
    empty.call(empty.mirror, "AnchorAuditLog", head(1))
    assert [each["seq"] for each in heads(empty)] == [1]
    assert [each["seq"] for each in heads(empty, "mona")] == [9_000]
    assert [each["anchored_by"] for each in (*heads(empty), *heads(empty, "mona"))] == ["mira", "mona"]
