"""A drone whose node ranges 0.3 m too long is calibrated at a pad, by the pad's side, and verified from then on."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace

import pytest
from click.testing import CliRunner

from wonderland.cli import main

BETWEEN = (300.0, -200.0, 1_500.0)
ASIDE = (-700.0, 500.0, 1_500.0)
DELAY_MM = 300.0


@pytest.fixture
async def path(world):
    world.flight = replace(world.flight, truth=BETWEEN, claimed=BETWEEN)
    world.delay_mm["uav"] = DELAY_MM
    path = world.directory / "pad.toml"
    anchors = "".join(f'[[anchors]]\nanchor_id = "{name}"\nport = "{world.ports[name].path}"\n' for name in world.own)
    path.write_text(f'pad_id = "pad-1"\nconnection = "ledger/connection.json"\nspool = "spool"\n{anchors}')
    # A contradiction would go on to the last round, at every session of this file.
    await world.policy(max_rounds=30)
    return path


def at(*places):
    return [part for place in places for part in ("--at", ",".join(f"{each / 1000:.3f}" for each in place))]


async def calibrate(path, *more):
    """The command, from when it listens: (exit code, what it says)."""
    arguments = ["pad", "calibrate-uav", "--config", str(path), "--uav", "uav-1", "--json", *more]
    result = await asyncio.to_thread(CliRunner().invoke, main, arguments)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


async def while_it_listens(world, path, *more, move=(BETWEEN,)):
    """The command beside a running pad and a drone that asks, at one place after the other; what it was told.

    It asks until the command has what it wants: on a busy machine that may begin to listen late.
    """
    start = await world.contract("mirror").height()
    if len(move) > 1:  # places in their order, whenever the command comes to them
        more = (*more, "--from-block", str(start))
    async with world.pad(), world.uav() as uav:
        listening = asyncio.create_task(calibrate(path, "--wait", "60", *more))
        verdicts = []
        for number in range(40):
            place = move[min(number, len(move) - 1)]
            world.flight = replace(world.flight, truth=place, claimed=place)
            verdicts.append((await uav.prove("pad-1", "land")).verdict)
            await asyncio.wait({listening}, timeout=0.3)
            if listening.done():
                break
        return await listening, verdicts


async def test_it_is_verified_from_then_on(world, path):
    more = [*at(BETWEEN, ASIDE), "--sessions", "1", "--yes", "--node", "DWM3001CDK 7"]
    (code, said), verdicts = await while_it_listens(world, path, *more, move=(BETWEEN, BETWEEN, ASIDE))
    assert code == 0, said
    found = json.loads(said[said.index("{") :])
    assert found["published"]
    assert abs(found["offset_mm"] - DELAY_MM) < 30
    assert 20 <= found["sigma_mm"] <= 30
    assert not found["rests_on_place"]
    assert verdicts[-1].outcome == "inconclusive"  # in the middle of the square its vague height explains it
    (kept,) = (await world.contract("mirror").read_uav("uav-1")).calibrations
    assert (kept.offset_mm, kept.registered_by) == (found["offset_mm"], "pad_operator")
    async with world.pad(), world.uav() as uav:
        verdict = (await uav.prove("pad-1", "land")).verdict
    assert verdict.outcome == "verified", verdict.reasons
    assert "calibrated" in {reason.code for reason in verdict.reasons}


async def test_a_wrong_mark_and_the_drones_own_operator_register_nothing(world, path):
    wrong = (ASIDE[0] + 500.0, ASIDE[1], ASIDE[2])
    more = [*at(wrong), "--yes", "--sessions", "1"]
    (code, said), _ = await while_it_listens(world, path, *more, move=(ASIDE,))
    assert code == 1
    assert "another place does: measure again" in said
    code, said = await calibrate(path, *at(BETWEEN), "--yes", "--identity", "fleet_operator")
    assert code == 1
    assert "somebody else has to measure" in said
    code, said = await calibrate(path, *at(BETWEEN), "--yes", "--wait", "1")
    assert code == 1
    assert "asked for nothing within 1 s" in said
    assert (await world.contract("mirror").read_uav("uav-1")).calibrations is None


async def test_a_dry_run_sends_nothing(world, path):
    (code, said), _ = await while_it_listens(world, path, *at(BETWEEN), "--dry-run", "--sessions", "1")
    assert code == 0, said
    dry = json.loads(said[said.index("{") :])
    assert not dry.pop("published")
    assert (await world.contract("mirror").read_uav("uav-1")).calibrations is None
    # The same sessions, afterwards.
    code, said = await calibrate(path, *at(BETWEEN), "--from-block", "0", "--sessions", "1", "--yes")
    assert code == 0, said
    later = json.loads(said[said.index("{") :])
    # And by a reference that was recorded while it hovered.
    track = world.directory / "track.csv"
    rows = [f"{each},{','.join(str(axis / 1000) for axis in BETWEEN)}" for each in (1.0, 4e9)]
    track.write_text("\n".join(["t,x,y,z", *rows]))
    more = ["--from-block", "0", "--sessions", "1", "--dry-run", "--reference"]
    code, said = await calibrate(path, *more, str(track))
    assert code == 0, said
    assert json.loads(said[said.index("{") :])["offset_mm"] == later["offset_mm"]
    track.write_text("\n".join(["t,x,y,z", rows[0], rows[0].replace("1.0,", "2.0,", 1)]))
    code, said = await calibrate(path, *more, str(track))
    assert code == 1
    assert "reaches from 1.0 to 2.0 s" in said
    assert {name: later[name] for name in dry} == dry
    assert later["published"]


@pytest.mark.parametrize("text", ["1,2", "a,b,c", "1,2,nan", "900,0,0"])
def test_places_that_are_none(tmp_path, text):
    arguments = ["pad", "calibrate-uav", "--config", str(tmp_path / "pad.toml"), "--uav", "u", "--at", text]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert "--at" in result.output
