"""A whole proof over google/pica: a controller of UCI that nobody here wrote, by the agents as operators start them."""

from dataclasses import replace

import pytest
from kit.agents import STAND, commissioning
from kit.pica import Pica, pica_binary

from wonderland.uwb.agreed import ASSUMED

pytestmark = pytest.mark.timeout(120)


@pytest.fixture
async def pica(world, tmp_path):
    pica_binary()
    async with Pica(dict(STAND) | {"uav": world.flight.truth}, tmp_path / "pica.log") as running:
        yield running


@pytest.mark.parametrize(("east_mm", "outcome"), [(0, "verified"), (3_000, "refuted")])
async def test_a_proof_is_decided_over_a_controller_of_others(world, pica, east_mm, outcome):
    """It carries data from the initiator only, has no UL-TDoA and numbers its capabilities as UCI 1 does."""
    record = replace(commissioning(world.clock()), nodes=replace(ASSUMED, words="initiator", blinks="none"))
    await world.call("pad_operator", "CommissionPad", pad_id="pad-1", commissioning=record.to_json())
    east, north, up = world.flight.truth
    world.flight.claimed = (east + east_mm, north, up)
    anchors = [{"anchor_id": name, "port": pica.port_of(name)} for name in STAND]
    async with (
        world.pad(anchors=anchors, uwb={"words": "initiator"}) as pad,
        world.uav(port=pica.port_of("uav"), words="initiator") as uav,
    ):
        assert pad.status()["reach"]["assurance"] == 2, "pica has no blinks"
        result = await uav.prove("pad-1", "land")
    assert result.verdict is not None, (result.state, result.end, result.detail)
    assert result.verdict.outcome == outcome
    assert result.verdict.permission == ("granted" if outcome == "verified" else "refused")
