"""Flights: positions that belong together, whatever the order in which they come."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from kit.description import document

from wonderland_backend.flights.grouping import GAP_MS, grouped, stretches
from wonderland_backend.flights.store import WRITE_EVERY_MS

START_MS = 1_800_000_000_000
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
DOCUMENT = document()
LAT, LON = 604_518_000, 222_666_000


def conforms(name, value):
    schema = {"$ref": f"#/components/schemas/{name}", "components": DOCUMENT["components"]}
    assert [each.message for each in Draft202012Validator(schema).iter_errors(value)] == []


def track(t_ms, uav_id="uav-1", north=0):
    return "track", {"uav_id": uav_id, "lat_e7": LAT + north, "lon_e7": LON, "transport": "ble4", "claim_t_ms": t_ms}


@both
async def test_positions_become_flights(running, agent_client, machine, clock):
    clock.now_ms = START_MS + 3_600_000
    async with running.connect("/ingest") as socket, machine("wonderland.tracks.read", role="inspector") as http:
        agent = agent_client(socket)
        await agent.hello()
        for index in range(3):
            await agent.report(track(0, north=index * 100), t_ms=START_MS + index * 60_000)
        for index in range(2):
            await agent.report(track(0, north=-500), t_ms=START_MS + 1_800_000 + index * 1_000)
        clock.now_ms += WRITE_EVERY_MS
        await agent.report(track(0, "uav-2"), t_ms=START_MS + 3_599_000)
        page = (await http.get("/api/v1/flights")).json()
        conforms("FlightPage", page)
        assert [(each["uav_id"], each["positions"], each["active"]) for each in page["items"]] == [
            ("uav-2", 1, True), ("uav-1", 2, False), ("uav-1", 3, False),
        ]  # fmt: skip
        oldest = page["items"][2]
        assert (oldest["start_ms"], oldest["end_ms"]) == (START_MS, START_MS + 120_000)
        assert (oldest["extent"]["south_e7"], oldest["extent"]["north_e7"]) == (LAT, LAT + 200)
        # What comes late closes a pause or lengthens a flight, which keeps its identifier.
        clock.now_ms += WRITE_EVERY_MS
        await agent.report(track(0, north=300), t_ms=START_MS - 60_000)
        again = (await http.get(f"/api/v1/flights/{oldest['flight_id']}")).json()
        conforms("Flight", again)
        assert (again["start_ms"], again["positions"]) == (START_MS - 60_000, 4)
        assert len(again["proofs"]) == 1
        for box, found in (
            ("22.2,60.45178,22.3,60.5", ["uav-2"]),
            ("22.2,60.4,22.3,60.5", ["uav-1", "uav-2"]),
            ("0,0,1,1", []),
        ):
            drones = (await running.json("/drones", bbox=box))["items"]
            assert [each["uav_id"] for each in drones] == found, "where they were heard last"
        path = f"/api/v1/flights/{oldest['flight_id']}"
        feature = (await http.get(path, headers={"Accept": "application/geo+json"})).json()
        assert feature["geometry"]["type"] == "LineString"
        assert feature["geometry"]["coordinates"][0] == [LON / 1e7, (LAT + 300) / 1e7]
        assert len(feature["geometry"]["coordinates"]) == 4
        for query, count in (
            ({"drone": "uav-2"}, 1),
            ({"operator": "fleet"}, 3),
            ({"since_ms": START_MS + 1_000_000}, 2),
            ({"until_ms": START_MS + 1_000_000}, 1),
            ({"bbox": "22.2,60.4,22.3,60.5"}, 3),
            ({"bbox": "22.2,60.451819,22.3,60.5"}, 1),
            ({"bbox": "179,-10,-179,10"}, 0),
            ({"limit": 1}, 1),
        ):
            assert len((await http.get("/api/v1/flights", params=query)).json()["items"]) == count, query
        assert (await http.get(f"/api/v1/flights/{'0' * 32}")).status_code == 404


async def test_an_operator_sees_its_own_flights_only(running, agent_client, machine):
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()
        await agent.report(track(0), t_ms=START_MS)
    for msp_id, count in (("FleetMSP", 1), ("OtherMSP", 0)):
        async with machine("wonderland.tracks.read", role="fleet_operator", msp_id=msp_id) as http:
            assert len((await http.get("/api/v1/flights")).json()["items"]) == count


@given(
    st.lists(st.integers(0, 40), min_size=1, max_size=40),
    st.lists(st.integers(1, 10), min_size=1, max_size=40),
    st.randoms(use_true_random=False),
)
def test_the_order_of_arrival_does_not_matter(minutes, sizes, random):
    """However they are shuffled and cut into batches, the same positions make the same flights."""
    positions = [(minute * 60_000 * 2, minute, minute) for minute in minutes]
    whole = {(each.start_ms, each.end_ms, each.positions) for each in stretches("uav", positions)}
    random.shuffle(positions)
    kept, at = {}, 0
    for size in [*sizes, len(positions)]:
        batch, at = positions[at : at + size], at + size
        if batch:
            changed, gone = grouped(kept.values(), stretches("uav", batch))
            for flight_id in gone:
                del kept[flight_id]
            kept |= {each.flight_id: each for each in changed}
    assert {(each.start_ms, each.end_ms, each.positions) for each in kept.values()} == whole
    ordered = sorted(kept.values(), key=lambda each: each.start_ms)
    assert all(after.start_ms - before.end_ms > GAP_MS for before, after in pairwise(ordered))
