"""Numbers that are none, as options."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from wonderland_edge_agent.commands import pad


@pytest.mark.parametrize(
    "option", ["--height", "--buffer", "--reference-sigma", "--installation-sigma", "--truth-raise"]
)
@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_options_that_are_no_finite_numbers_are_refused_by_name(tmp_path, option, value):
    survey = tmp_path / "anchors.csv"
    survey.write_text("anchor_id,x,y,z\n")
    done = CliRunner().invoke(pad, ["commission", "--anchors", str(survey), f"{option}={value}"])
    assert done.exit_code == 2
    assert option in done.output
