"""The live WebSocket for machines: with a token that opens all that is on it, and for no longer than that lasts."""

from __future__ import annotations

import asyncio
import json

import pytest
import websockets
from sqlalchemy import update

from wonderland_backend import app as application
from wonderland_backend.clients.scopes import LIVE
from wonderland_backend.clients.store import NewClient
from wonderland_backend.db.tables.people import PersonRow
from wonderland_backend.people import store as people
from wonderland_backend.people.schemas import Invitation
from wonderland_backend.person import Account

ALL = " ".join(LIVE)


@pytest.fixture(autouse=True)
def _looked_at_often(monkeypatch):
    """Before the backend begins, which looks at its live connections every so often."""
    monkeypatch.setattr(application, "CHECK_EVERY_S", 0.05)


async def closed_with(socket):
    with pytest.raises(websockets.ConnectionClosed) as closed:
        async with asyncio.timeout(10):
            while True:
                await socket.recv()
    return closed.value.rcvd.code


def live(running, http):
    return running.connect("/api/v1/live", additional_headers={"Authorization": http.headers["Authorization"]})


async def test_a_machine_sees_what_its_role_sees(running, machine):
    async with machine(ALL, role="inspector") as http, live(running, http) as socket:
        assert json.loads(await socket.recv())["type"] == "hello"
        pads = json.loads(await socket.recv())["pads"]
        assert [each["pad_id"] for each in pads] == ["pad-1", "pad-2"]
    async with machine(ALL, role="fleet_operator", msp_id="OtherMSP") as http, live(running, http) as socket:
        assert json.loads(await socket.recv())["type"] == "hello"
        first = json.loads(await socket.recv())
        assert first.get("sessions", []) == first.get("verdicts", []) == []


@pytest.mark.parametrize("left_out", LIVE)
async def test_every_scope_is_needed(running, machine, left_out):
    scopes = " ".join(set(LIVE) - {left_out})
    async with machine(scopes, role="inspector") as http, live(running, http) as socket:
        assert await closed_with(socket) == 4403


@pytest.mark.parametrize("authorization", ["Bearer nonsense", "Basic x", "", "Bearer "])
async def test_what_is_no_token_opens_nothing_even_beside_a_cookie(running, authorization):
    headers = {"Authorization": authorization, "Cookie": running.cookie()}
    async with running.connect("/api/v1/live", additional_headers=headers) as socket:
        assert await closed_with(socket) == 4401


async def test_it_ends_with_the_token(running, machine, clock):
    async with machine(ALL, role="inspector") as http, live(running, http) as socket, running.live() as person:
        await socket.recv()
        await person.recv()
        await asyncio.sleep(0.3)
        assert socket.state is websockets.State.OPEN
        clock.now_ms += 3_600_000
        assert await closed_with(socket) == 4401
        assert person.state is websockets.State.OPEN, "a sign-in lasts longer"


async def test_it_ends_when_the_machine_is_revoked(running, machine):
    async with machine(ALL, role="inspector") as http, live(running, http) as socket:
        await socket.recv()
        async with running.context.database.write() as connection:
            await running.parts.clients.revoke(connection, http.client_id, "a test")
        assert await closed_with(socket) == 4401


async def test_it_ends_when_its_person_loses_a_role(running):
    """An inspector's machine would go on seeing all that inspectors see, until its token ends."""
    ada = Account("a" * 32, "Ada")
    async with running.context.database.write() as connection:
        invitation = Invitation(name="Ada", roles=["inspector"])
        await people.create(connection, ada, invitation, ada.person_id, state="active", now_ms=0)
        row, secret = await running.parts.clients.add(connection, NewClient("Bot", LIVE, "inspector"), ada)
    form = {"grant_type": "client_credentials"}
    answer = await running.http.post("/oauth/token", data=form, auth=(row.client_id, secret))
    bearer = {"Authorization": f"Bearer {answer.json()['access_token']}"}
    async with running.connect("/api/v1/live", additional_headers=bearer) as socket:
        await socket.recv()
        await asyncio.sleep(0.3)
        assert socket.state is websockets.State.OPEN
        async with running.context.database.write() as connection:
            await connection.execute(
                update(PersonRow).where(PersonRow.person_id == ada.person_id).values(roles="viewer")
            )
        assert await closed_with(socket) == 4401
    async with running.connect("/api/v1/live", additional_headers=bearer) as socket:
        assert json.loads(await socket.recv())["type"] == "hello", "as a viewer it may come again"
