"""Traffic by EU 2021/664: which recipient gets which fields, heights above the sea, the stream."""

from __future__ import annotations

import asyncio
import json

import pytest
from kit.geoids import write_geoid
from sqlalchemy import select

from wonderland_backend.db.tables.audit import AuditRow
from wonderland_backend.errors import SettingsError
from wonderland_backend.settings import Settings
from wonderland_backend.uspace.eu664.schemas import Traffic
from wonderland_backend.uspace.service import USpace


@pytest.fixture
def geoid_file(tmp_path):
    return write_geoid(tmp_path / "WW15MGH.DAC")


def test_a_file_that_is_no_geoid_is_named_with_its_setting(tmp_path):
    settings = Settings(uspace={"geoid_file": str(tmp_path / "none")})
    with pytest.raises(SettingsError, match=r"uspace\.geoid_file: .*none: No such file"):
        USpace(settings, lambda: 0)


@pytest.fixture
async def uss(new_uss, geoid_file):
    async with new_uss(geoid_file=str(geoid_file), serve="ours", operators=["FIN87astrdge12k8"]) as found:
        yield found


async def traffic(uss, recipient, **options):
    answer = await uss.ask("GET", "/api/v1/traffic", f"wonderland.traffic.{recipient}", **options)
    assert answer.status_code == 200, answer.text
    Traffic.model_validate(answer.json())
    return answer.json()


async def test_what_each_recipient_gets(uss, track):
    await uss.heard(track(operator_id="FIN87astrdge12k8-xyz", status="emergency"))
    now = uss.uspace.clock()
    for recipient in ("authority", "ats", "ussp"):
        found = await traffic(uss, recipient)
        assert found["recipient"] == recipient
        (item,) = found["items"]
        assert now - 5_000 < item.pop("t_ms") <= item.pop("heard_ms") <= now
        item.pop("flight_id")
        assert item == {
            "lat_e7": 604_518_000, "lon_e7": 222_666_000, "altitude_wgs84_mm": 40_000,
            "altitude_amsl_mm": 40_000 - 60_452, "height_mm": 12_000, "height_above": "takeoff", "course_cdeg": 9_000,
            "ground_speed_mm_s": 5_250, "emergency": "emergency", "serial": "1581F5FKD229400A1234",
            "operator_registration": "FIN87astrdge12k8",
            "pilot": {"lat_e7": 604_520_000, "lon_e7": 222_670_000, "place": "takeoff"},
            "source": "service_provider", "verified": False,
        }  # fmt: skip
    (item,) = (await traffic(uss, "public"))["items"]
    assert {"serial", "operator_registration", "pilot"}.isdisjoint(item)
    assert item["altitude_amsl_mm"] == -20_452


async def test_who_is_signed_in_sees_what_the_public_sees(uss, track):
    await uss.heard(track(), track("HEARD", operator_id="FIN87astrdge12k9"))
    assert (await uss.http.get("/api/v1/traffic")).status_code == 401
    assert (await uss.ask("GET", "/api/v1/traffic", "rid.display_provider")).status_code == 403
    await uss.sign_in()
    found = (await uss.http.get("/api/v1/traffic")).json()
    assert found["recipient"] == "public"
    assert sorted(each["source"] for each in found["items"]) == ["broadcast", "service_provider"]
    assert "1581F5FKD229400A1234" not in json.dumps(found)
    assert (await uss.http.get("/api/v1/traffic?bbox=22,60,23,61")).json()["items"] != []
    assert (await uss.http.get("/api/v1/traffic?bbox=23,60,24,61")).json()["items"] == []
    assert (await uss.http.get("/api/v1/traffic?bbox=0,91,1,92")).status_code == 400
    assert (await uss.http.get("/api/v1/traffic?area=1")).status_code == 422


async def test_without_a_geoid_no_height_above_the_sea_is_made_up(new_uss, track):
    async with new_uss() as uss:
        await uss.heard(track())
        (item,) = (await traffic(uss, "authority"))["items"]
        assert "altitude_amsl_mm" not in item
        assert item["altitude_wgs84_mm"] == 40_000


async def test_the_stream_has_everything_once_and_then_what_changes(uss, track):
    await uss.heard(track(), track("SECOND"))
    token = uss.authority.token(scope="wonderland.traffic.ussp")
    headers = {"Authorization": f"Bearer {token}", "Accept": "text/event-stream"}
    events = []

    async def listen():
        async with uss.http.stream("GET", "/api/v1/traffic", headers=headers) as answer:
            assert answer.headers["content-type"].startswith("text/event-stream")
            async for line in answer.aiter_lines():
                if line.startswith("data: "):
                    events.append(json.loads(line.removeprefix("data: ")))
                    if len(events) == 2:
                        return

    async with asyncio.timeout(20):
        listening = asyncio.create_task(listen())
        while not events:
            await asyncio.sleep(0.02)
        await asyncio.sleep(0.6)
        await uss.heard(track("SECOND", lat=604_519_000))
        await listening
    assert sorted(each["serial"] for each in events[0]["items"]) == ["1581F5FKD229400A1234", "SECOND"]
    assert [(each["serial"], each["lat_e7"]) for each in events[1]["items"]] == [("SECOND", 604_519_000)]


async def test_who_is_told_operators_is_in_the_log_once_an_hour(uss, track, clock):
    await uss.heard(track(operator_id="FIN87astrdge12k8-xyz"))
    await traffic(uss, "public")
    for _ in range(3):
        await traffic(uss, "ats")
        clock.now_ms += 60_001
    async with uss.backend.database.read() as session:
        rows = (await session.execute(select(AuditRow.subject).where(AuditRow.act == "read_personal_data"))).all()
    assert [each.subject for each in rows] == ["traffic/ats"]
