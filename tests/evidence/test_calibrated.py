"""A verdict that rests on a drone's calibration is verified by whoever has the file alone."""

from __future__ import annotations

import pytest
from kit.evidence import exhibit
from kit.scenario_world import PLACES

from wonderland_evidence.case import Case
from wonderland_evidence.places import used
from wonderland_evidence.record_steps import verdict_of

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    place = PLACES["embedded"](tmp_path_factory.mktemp("calibrated"))
    place.start()
    yield exhibit(place, tmp_path_factory.mktemp("calibrated-evidence"), "c1", calibrated=True)
    place.stop()


def test_it_holds_in_every_step_with_the_transaction_that_registered_it(calibrated):
    report = calibrated.report()
    assert report.failed is None, report.failed
    assert report.is_whole
    case = Case(calibrated.bundle)
    assert "CalibrateUav" in {case.transaction(place, "").invocation.function for place in used(case)}
    assert "calibrated" in {reason.code for reason in verdict_of(case).reasons}
