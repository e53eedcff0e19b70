"""When each step happened: the ledger says that there is a permission, the pad when it had effect."""

from __future__ import annotations

import pytest

from wonderland_backend.mirror.rows import OUTLINE, SessionWrite
from wonderland_backend.sessions.state import PAD, UAV, ReportedStep, SessionView


@pytest.fixture
def view():
    outline = dict.fromkeys(OUTLINE) | {
        "session_id": "s",
        "pad_id": "pad-1",
        "uav_id": "uav-1",
        "state": "decided",
        "requested_ms": 1_000,
        "decided_ms": 5_000,
    }
    return SessionView(SessionWrite(**outline), outcome="verified", permission="granted", rounds=10)


def permission(view):
    return next(step for step in view.steps() if step.step == "permission")


def test_a_permission_is_dated_by_the_pad_that_opened(view):
    assert permission(view).t_ms == 5_000
    view.report([ReportedStep("permission", 5_400, True, UAV, agent_id="uav-1")])
    assert permission(view).t_ms == 5_400
    view.report([ReportedStep("permission", 5_250, True, PAD, agent_id="pad-1")])
    step = permission(view)
    assert (step.t_ms, step.ok, step.source, step.detail) == (5_250, True, "ledger", "granted")


@pytest.mark.parametrize(
    "told",
    [
        ReportedStep("permission", 4_000, True, PAD, agent_id="pad-1"),
        ReportedStep("permission", 5_300, False, PAD, agent_id="pad-1"),
        ReportedStep("permission", 5_300, True, PAD, agent_id="pad-2"),
    ],
)
def test_nobody_dates_it_before_the_verdict_or_against_the_ledger(view, told):
    view.report([told])
    assert permission(view).t_ms == 5_000
