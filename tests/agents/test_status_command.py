"""``wonderland pad status`` beside a running agent: its exit code and its words are about what the pad can do now."""

from __future__ import annotations

import asyncio
import json
import os

import pytest
from click.testing import CliRunner
from kit.agents import cured, hang

from wonderland.cli import main
from wonderland_edge_agent.commissioning.alone import alone
from wonderland_edge_agent.spool.lock import LOCK_NAME, ProcessLock, holder_of
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration

CAN, DOES_NOT_RUN, CANNOT, NOT_KNOWN = 0, 1, 3, 4
NOTICED_S = 8.0


@pytest.fixture(autouse=True)
def _care_comes_soon(monkeypatch):
    monkeypatch.setattr("wonderland_edge_agent.agent.CARE_S", 0.5)


def settings_file(world, pad_id="pad-1", identity="pad"):
    """As ``world.pad`` has them, in a file for the command."""
    path = world.directory / "pad.toml"
    anchors = "".join(f'[[anchors]]\nanchor_id = "{name}"\nport = "{world.ports[name].path}"\n' for name in world.own)
    path.write_text(
        f'pad_id = "{pad_id}"\nconnection = "ledger/connection.json"\nidentity = "{identity}"\nspool = "spool"\n{anchors}'
    )
    return path


async def said(path, code, *words, limit_s=NOTICED_S):
    """Until the command ends with this code and says all of these."""
    output = "never called"
    try:
        async with asyncio.timeout(limit_s):
            while True:
                result = await asyncio.to_thread(CliRunner().invoke, main, ["pad", "status", "--config", str(path)])
                output = f"{result.exit_code}: {result.output}"
                if result.exit_code == code and all(word in result.output for word in words):
                    return
                await asyncio.sleep(0.2)
    except TimeoutError:
        pytest.fail(output)


async def test_a_pad_that_can_prove_one_whose_anchors_are_gone_and_one_that_does_not_run(world):
    path = settings_file(world)
    await said(path, DOES_NOT_RUN, "status")
    async with world.pad():
        await said(path, CAN, "can prove")
        for name in world.own:
            world.ports[name].unplug()
        await said(path, CANNOT, "cannot prove", "0 of 4 anchors can range", "A1 (", "A4 (")


async def test_an_agent_that_was_stopped_does_not_run_any_more_that_very_moment(world):
    path = settings_file(world)
    async with world.pad():
        await said(path, CAN, "can prove")
    result = await asyncio.to_thread(CliRunner().invoke, main, ["pad", "status", "--config", str(path)])
    assert result.exit_code == DOES_NOT_RUN
    assert "not running" in result.output
    assert "can prove" not in result.output


async def test_somebody_else_who_holds_the_spool_is_no_agent(world):
    path = settings_file(world)
    async with world.pad():
        await said(path, CAN, "can prove")
    status = world.directory / "spool" / "status.json"
    status.write_text(json.dumps(json.loads(status.read_text()) | {"process": 1}))
    with alone(world.directory / "spool"):
        await said(path, DOES_NOT_RUN, "not running")


async def test_one_that_holds_the_spool_and_says_nothing_hangs(world, monkeypatch):
    path = settings_file(world)
    async with world.pad():
        await said(path, CAN, "can prove")
        monkeypatch.setattr("wonderland_edge_agent.status_command.STALE_S", -1)
        await said(path, DOES_NOT_RUN, "hangs: silent for")


def test_who_asks_for_a_lock_keeps_nobody_from_it(tmp_path):
    assert holder_of(tmp_path / LOCK_NAME) is None
    lock = ProcessLock(tmp_path / LOCK_NAME)
    assert holder_of(tmp_path / LOCK_NAME) == str(os.getpid())
    lock.release()
    assert holder_of(tmp_path / LOCK_NAME) is None


async def test_anchors_that_hear_nobody_have_an_exit_code_of_their_own(world):
    path = settings_file(world)
    world.mute = set(world.own)
    async with world.pad():
        await said(path, NOT_KNOWN, "not known whether it can prove", "(A1, A2, A3, A4)", limit_s=3 * NOTICED_S)


async def test_a_missing_anchor_of_four_is_named_with_why(world):
    path = settings_file(world)
    world.ports["A3"].unplug()
    async with world.pad():
        await said(path, CANNOT, "3 of 4 anchors can range, 4 are needed", "A3 (", "anchor A3", "down")


async def test_a_missing_anchor_of_five_is_named_and_the_pad_goes_on(world):
    await world.extend(5)
    path = settings_file(world)
    world.ports["A3"].unplug()
    async with world.pad():
        await said(path, CAN, "can prove", "goes on without A3 (")


async def test_a_node_that_hangs_and_comes_back(world):
    path = settings_file(world)
    async with world.pad():
        await said(path, CAN)
        hang(world.ports["A2"])
        await said(path, CANNOT, "3 of 4 anchors can range, 4 are needed", "A2 (")
        cured(world.ports["A2"])
        world.ports["A2"].unplug()
        world.ports["A2"].plug()
        await said(path, CAN, limit_s=2 * NOTICED_S)


async def test_a_node_that_answers_and_never_ranges(world):
    path = settings_file(world)
    world.mute = {"A2"}
    async with world.pad():
        await said(path, CANNOT, "3 of 4 anchors can range, 4 are needed", "A2 (", limit_s=3 * NOTICED_S)


async def test_a_policy_that_demands_more_than_the_nodes_bear(world):
    path = settings_file(world)
    async with world.pad():
        await said(path, CAN)
        await world.policy(min_assurance=3)
        await said(
            path,
            CANNOT,
            "the policy demands assurance 3",
            "(A1, A2, A3, A4 cannot do UL-TDoA)",
            limit_s=3 * NOTICED_S,
        )
        await world.policy(min_assurance=2)
        await said(path, CAN, limit_s=3 * NOTICED_S)


async def test_a_policy_of_one_action_that_demands_too_much_keeps_the_others_going(world):
    path = settings_file(world)
    async with world.pad():
        await world.policy(action="dock", min_assurance=3)
        await said(path, CAN, "cannot prove to dock: the policy demands assurance 3", limit_s=3 * NOTICED_S)


async def test_a_lost_ledger(world):
    path = settings_file(world)
    async with world.pad():
        await said(path, CAN)
        await world.ledger.stop()
        await said(path, CANNOT, "the ledger is away")
    await world.ledger.start()


async def test_a_pad_that_the_ledger_does_not_know_and_then_one_without_commissioning(world):
    DirectoryAdministration(world.ledger.directory).enrol("pad-9", role="pad", pol_id="pad-9")
    world.all_identities = Connection.load(world.directory / "ledger")
    path = settings_file(world, "pad-9", "pad-9")
    async with world.pad(ready=False, pad_id="pad-9", identity="pad-9"):
        await said(path, CANNOT, "the ledger refuses this pad")
        place = world.commissioning().frame
        await world.call(
            "pad_operator",
            "RegisterPad",
            pad_id="pad-9",
            name="New",
            operator_id="harbour",
            lat_e7=place.lat_e7,
            lon_e7=place.lon_e7,
            height_mm=place.height_mm,
        )
        await said(path, CANNOT, "not commissioned (wonderland pad commission)")
