"""Drones whose own agent says where they are, and drones that do not say whose they are."""

from __future__ import annotations

import orjson
from kit.openings import keep, opening
from msgspec import Raw
from sqlalchemy import insert, update

from wonderland_backend.agents.connected import Agent
from wonderland_backend.db.tables.ledger import DroneRow
from wonderland_backend.db.tables.numbers import RegistrationNumberRow
from wonderland_backend.ingest.batch import read

VIEW = "60.44,22.25,60.46,22.29"
SERIAL = "1581F5FKD229400A1234"


def position(now, **change):
    body = {
        "lat_e7": 604_518_000, "lon_e7": 222_666_000, "claim_t_ms": now, "height_mm": 40_000, "accuracy_mm": 900,
        "height_accuracy_mm": 2_500,
    } | change  # fmt: skip
    return {"seq": now, "kind": "position", "t_ms": now, "body": body}


async def say(uss, agent, *records):
    batch = read(agent, [Raw(orjson.dumps(each)) for each in records], acknowledged=0, now_ms=uss.uspace.clock())
    await (await uss.backend.parts.intake.take_batch(batch))
    return batch.rejected


async def flights(uss):
    return (await uss.get("/uss/flights", params={"view": VIEW})).json()["flights"]


async def test_a_drones_own_word_counts_for_more_than_what_is_broadcast_in_its_name(new_uss, track, clock):
    async with new_uss(clock=clock, serve="ours") as uss:
        token = uss.authority.token
        uss.authority.token = lambda **claims: token(now_s=clock() // 1000, **claims)
        drone = Agent("uav", SERIAL, "1" * 32)
        uss.backend.parts.agents.join(drone)
        assert await say(uss, drone, position(clock())) == []
        clock.pass_s(1)
        await uss.heard(track(lat=604_530_000, claim_t_ms=clock()))
        (flight,) = await flights(uss)
        state = flight["current_state"]
        assert (state["position"]["lat"], state["position"]["accuracy_h"]) == (60.4518, "HA1m")
        assert state["position"]["accuracy_v"] == "VA3m"
        # Silent for a while, it is known by its broadcasts again.
        clock.pass_s(5)
        await uss.heard(track(lat=604_530_000, claim_t_ms=clock()))
        (flight,) = await flights(uss)
        assert flight["current_state"]["position"]["lat"] == 60.453


async def test_nobody_speaks_for_another(new_uss):
    async with new_uss() as uss:
        now = uss.uspace.clock()
        pad = Agent("pad", "pad-1", "1" * 32)
        assert [each[1] for each in await say(uss, pad, position(now))] == ["not_allowed"]
        drone = Agent("uav", "x" * 60, "1" * 32)
        assert [each[1] for each in await say(uss, drone, position(now))] == ["bad_body"]
        drone = Agent("uav", SERIAL, "1" * 32)
        assert [each[1] for each in await say(uss, drone, position(now, uav_id="OTHER"))] == ["bad_body"]
        assert await flights(uss) == []


async def test_who_operates_a_drone_that_does_not_say_so_is_in_the_registry(new_uss, track, until):
    async with new_uss() as uss:
        its = opening(SERIAL)
        record = {"uav_id": SERIAL, "registration_commitment": its.commitment}
        await keep(uss.backend.database, its)
        async with uss.backend.database.write() as connection:
            columns = {column.name: "" for column in DroneRow.__table__.columns if not column.nullable}
            numbers = {name: 0 for name, column in DroneRow.__table__.columns.items() if column.type.python_type is int}
            row = columns | numbers | {"uav_id": SERIAL, "record": orjson.dumps(record).decode()}
            await connection.execute(insert(DroneRow), [row])
        await uss.heard(track(operator_id=None))

        def named():
            (flight,) = uss.uspace.flights
            return flight.details.operator.registration

        assert await until(named) == "FIN87astrdge12k8"
        await uss.heard(track(operator_id=None, lat=604_519_000))
        assert named() == "FIN87astrdge12k8"
        await uss.heard(track(operator_id="FIN87astrdge12k9", lat=604_520_000))
        assert named() == "FIN87astrdge12k9"


async def test_a_number_that_does_not_open_what_the_ledger_has_is_told_to_nobody(new_uss, track, until):
    async with new_uss() as uss:
        record = {"uav_id": SERIAL, "registration_commitment": opening(SERIAL).commitment}
        await keep(uss.backend.database, opening(SERIAL))
        async with uss.backend.database.write() as connection:
            await connection.execute(update(RegistrationNumberRow).values(number="SWE01abcdefghij2"))
            columns = {column.name: "" for column in DroneRow.__table__.columns if not column.nullable}
            numbers = {name: 0 for name, column in DroneRow.__table__.columns.items() if column.type.python_type is int}
            row = columns | numbers | {"uav_id": SERIAL, "record": orjson.dumps(record).decode()}
            await connection.execute(insert(DroneRow), [row])
        await uss.heard(track(operator_id=None))
        await uss.heard(track(operator_id=None, lat=604_519_000))
        (flight,) = uss.uspace.flights
        assert flight.details.operator.registration is None
