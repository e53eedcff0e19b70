"""What a permission switches at the pad, and an agent that cannot go on."""

from __future__ import annotations

import asyncio
import stat

import pytest

from wonderland_edge_agent.assembly import open_pad
from wonderland_edge_agent.permission import CommandPermission, LogPermission, Permissions
from wonderland_edge_agent.ports import AgentError


@pytest.fixture
def verdict(make_duo):
    duo = make_duo()
    duo.run()
    return duo.verdict


def program(path, text):
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


async def test_the_operators_program_hears_of_granting_and_withdrawing(tmp_path, verdict):
    said = tmp_path / "said"
    permission = Permissions(
        LogPermission(), CommandPermission([program(tmp_path / "lights", f'echo "$@" >> {said}'), "x"])
    )
    await permission.grant(verdict)
    await permission.withdraw(verdict, "completed")
    assert said.read_text().splitlines() == [
        f"x granted uav-1 land {verdict.session_id}",
        f"x withdrawn uav-1 land {verdict.session_id}",
    ]


async def test_a_program_that_fails_hangs_or_is_missing_is_reported_and_stops_nothing(
    tmp_path, verdict, caplog, monkeypatch
):
    monkeypatch.setattr("wonderland_edge_agent.permission.permission.COMMAND_TIMEOUT_S", 0.2)

    class Broken:
        async def grant(self, verdict):
            raise RuntimeError("relay board on fire")

    granted = []

    class Works:
        async def grant(self, verdict):
            granted.append(verdict)

    await Permissions(
        CommandPermission([program(tmp_path / "fails", "exit 3")]),
        CommandPermission([program(tmp_path / "hangs", "exec sleep 30")]),
        CommandPermission([str(tmp_path / "missing")]),
        Broken(),
        Works(),
    ).grant(verdict)
    assert granted == [verdict]
    text = caplog.text
    for complaint in ("ended with status 3", "did not end within", "cannot be run", "relay board on fire"):
        assert complaint in text


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("{", "holds no checkpoint"),
        ('{"block_number": 999999, "transaction_id": ""}', "checkpoint"),
        (f'{{"block_number": 3, "transaction_id": "{"f" * 64}"}}', "no transaction"),
    ],
)
async def test_a_place_that_is_not_on_this_ledger_stops_the_agent_in_words(world, content, complaint):
    (world.directory / "spool").mkdir(mode=0o700)
    (world.directory / "spool" / "events.json").write_text(content)
    async with open_pad(world.settings()) as agent:
        with pytest.raises(AgentError, match=complaint):
            await asyncio.wait_for(agent.run(), 20)
