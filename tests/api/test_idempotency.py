"""Writes that are sent twice: which take a key, what is kept of their answers, and what a server's stop leaves."""

from __future__ import annotations

import json

import pytest
from kit.description import document
from sqlalchemy import select, update

from wonderland_backend.clients.idempotency import HEADER, KEPT_MS, LEASE_MS
from wonderland_backend.clients.scopes import scopes_for
from wonderland_backend.db.tables.clients import IdempotencyRow
from wonderland_backend.reference.openapi import operations

BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
KEY = {HEADER: "8e03978e-40d5-43dd-bc93-6894a57f9324"}
CLIENT = {"name": "City U-space", "scopes": ["wonderland.proofs.read"]}


@pytest.fixture
async def admin(running):
    token = await running.parts.sign_ins.new_token("Admin", ("admin",))
    assert (await running.http.post("/api/v1/session", json={"token": token})).status_code == 200
    return running.http


def test_what_makes_something_takes_a_key():
    takes, machines = set(), set()
    for path, method, operation in operations(document()):
        if any(each["name"] == HEADER for each in operation.get("parameters", ())):
            takes.add(path.removeprefix("/api/v1"))
        if method == "post" and any(scopes_for(method, tag) for tag in operation["tags"]):
            machines.add(path.removeprefix("/api/v1"))
    # Neither leaves anything behind that a second one would double.
    assert machines - {"/geo-awareness", "/subscriptions/{subscription_id}/test"} <= takes
    assert takes - machines == {"/clients", "/people"}


@both
async def test_a_client_is_registered_once_and_its_secret_is_not_kept(running, admin):
    first, again = [await admin.post("/api/v1/clients", json=CLIENT, headers=KEY) for _ in range(2)]
    assert (first.status_code, again.status_code) == (201, 201), first.text
    assert again.headers["idempotency-replayed"] == "true"
    assert (again.json(), again.headers["location"]) == (first.json(), first.headers["location"])
    assert len((await admin.get("/api/v1/clients")).json()["items"]) == 1
    async with running.context.database.read() as session:
        (row,) = (await session.scalars(select(IdempotencyRow))).all()
    kept = json.dumps([row.key, row.body, row.location])
    assert first.json()["client_secret"] not in kept
    assert KEY[HEADER] not in kept


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/api/v1/exports", {"from_ms": 1_800_000_000_000, "until_ms": 1_800_000_060_000, "format": "geojson"}),
        ("/api/v1/people", {"name": "Aino", "roles": ["inspector"]}),
    ],
)
async def test_other_things_are_made_once(admin, path, body):
    first, again = [await admin.post(path, json=body, headers=KEY) for _ in range(2)]
    assert (first.status_code, again.status_code, again.json()) == (201, 201, first.json()), first.text


@both
async def test_a_server_that_stopped_meanwhile_holds_the_key_for_two_minutes(running, admin, clock):
    assert (await admin.post("/api/v1/clients", json=CLIENT, headers=KEY)).status_code == 201
    async with running.context.database.write() as connection:
        await connection.execute(update(IdempotencyRow).values(status=None, body=None, location=None))
    assert (await admin.post("/api/v1/clients", json=CLIENT, headers=KEY)).status_code == 409
    clock.now_ms += LEASE_MS + 1
    again = await admin.post("/api/v1/clients", json=CLIENT, headers=KEY)
    assert (again.status_code, again.headers.get("idempotency-replayed")) == (201, None)
    clock.now_ms += LEASE_MS + 1
    kept = await admin.post("/api/v1/clients", json=CLIENT, headers=KEY)
    assert (kept.json(), kept.headers["idempotency-replayed"]) == (again.json(), "true")
    assert LEASE_MS < KEPT_MS
