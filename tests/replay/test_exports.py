"""Exports of a window: what the files say, that they are whole, whose they are, and what is refused."""

from __future__ import annotations

import csv
import hashlib
import io
import itertools
import json
import zipfile
from datetime import datetime

import pytest
from shapely.geometry import shape
from sqlalchemy import func, select, update

from wonderland_backend.db.tables.audit import AuditRow
from wonderland_backend.db.tables.exports import ExportRow
from wonderland_backend.exports.formats import _cell
from wonderland_backend.exports.schemas import ExportArea

START_MS = 1_800_000_000_000
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
WINDOW = {"from_ms": START_MS, "until_ms": START_MS + 60_000}
TRACK = {"uav_id": "uav-1", "lat_e7": 604_518_000, "lon_e7": 222_666_000, "transport": "wifi", "operator_id": "FIN1"}
PLACE = {"uav_id": "uav-1", "lat_e7": 604_518_900, "lon_e7": 222_666_000}
NUMBERS = {"east_mm": 10, "north_mm": 1_000, "ee_mm2": 100, "en_mm2": 5, "nn_mm2": 90}


@pytest.fixture
async def stored(running, agent_client, number, clock):
    """Two drones heard by two pads, one of them ranged, and the fixture's two verdicts."""
    session_id = number("session", "three")
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket, agent_id="pad-2")
        await agent.hello()
        for second in range(5):
            t_ms = START_MS + 1_000 * second
            clock.now_ms = max(clock.now_ms, t_ms)
            body = TRACK | {"lat_e7": TRACK["lat_e7"] + second, "accuracy_mm": 3_000}
            estimate = PLACE | NUMBERS | {"session_id": session_id, "rounds": second, "likelihood_ppm": 9, "ranges": {}}
            await agent.report(("track", body), ("estimate", estimate), t_ms=t_ms)
        await agent.report(("track", TRACK | {"uav_id": "uav-2", "lat_e7": 0}), t_ms=START_MS + 2_000)
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket, agent_id="pad-1")
        await agent.hello()
        await agent.report(("track", TRACK | {"lon_e7": 1}), t_ms=START_MS + 2_000)
    return running


async def export(running, **query):
    """What an export gives: its files by name, its manifest, how it is described afterwards."""
    asked = await running.http.post("/api/v1/exports", json=WINDOW | query)
    assert asked.status_code == 201, asked.text
    answer = await running.get(f"/exports/{asked.json()['export_id']}/file")
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/zip"
    packed = zipfile.ZipFile(io.BytesIO(answer.content))
    assert packed.testzip() is None
    files = {name: packed.read(name) for name in packed.namelist()}
    manifest = json.loads(files.pop("manifest.json"))
    described = (await running.get(f"/exports/{asked.json()['export_id']}")).json()
    assert described["state"] == "done"
    assert described["sha256"] == hashlib.sha256(answer.content).hexdigest()
    assert described["bytes"] == len(answer.content)
    assert [(each["name"], each["bytes"], each["sha256"]) for each in manifest["files"]] == [
        (name, len(data), hashlib.sha256(data).hexdigest()) for name, data in files.items()
    ]
    return files, manifest, described


@both
async def test_geojson_has_claims_estimates_and_verdicts_apart(stored):
    files, manifest, described = await export(stored, format="geojson")
    collection = json.loads(files["window.geojson"])
    kinds = [feature["properties"]["kind"] for feature in collection["features"]]
    assert {kind: kinds.count(kind) for kind in kinds} == {"claimed": 7, "estimate": 5, "verdict": 2}
    assert manifest["counts"] == {"claimed": 7, "estimate": 5, "verdict": 2, "left_out_same_moment": 0}
    assert described["rows"] == 14
    for feature in collection["features"]:
        point = shape(feature["geometry"])
        assert point.is_valid
        assert point.geom_type == "Point"
        assert -180 <= point.x <= 180
        assert -90 <= point.y <= 90
        properties = feature["properties"]
        assert properties["verified"] is (properties.get("outcome") == "verified"), "a refutation verifies nothing"
        assert datetime.fromisoformat(properties["time"]).timestamp() * 1000 == properties["t_ms"]
        assert "operator_id" not in properties, "personal data stay behind"
    assert manifest["query"] == {"format": "geojson", **WINDOW}
    assert manifest["software"].startswith("wonderland ")
    assert manifest["ledger"]["channel"] == "wonderland"
    assert manifest["ledger"]["block_at_until"] == manifest["ledger"]["block_when_made"] > 0


@both
async def test_csv_tables_say_the_same(stored):
    files, manifest, _ = await export(stored, format="csv")
    tables = {name: list(csv.DictReader(io.StringIO(data.decode()))) for name, data in files.items()}
    assert {name: len(rows) for name, rows in tables.items()} == {"claimed.csv": 7, "estimate.csv": 5, "verdict.csv": 2}
    assert [row["lat_e7"] for row in tables["claimed.csv"][:3]] == ["604518000", "604518001", "604518002"]
    assert tables["claimed.csv"][0]["accuracy_mm"] == "3000"
    assert {row["outcome"] for row in tables["verdict.csv"]} == {"verified", "refuted"}
    assert manifest["units"]["_e7"] == "degrees × 10⁷, WGS-84"


def test_a_text_that_a_spreadsheet_would_calculate_is_shown_instead():
    assert _cell("=1+1") == "'=1+1"
    assert [_cell(each) for each in (None, -5, "wifi", "@x")] == ["", -5, "wifi", "'@x"]


def require_moving_point(geometry):
    """OGC 19-045r3, 7.2.3: as many places as moments, which rise."""
    assert geometry["type"] == "MovingPoint"
    assert geometry["interpolation"] in {"Discrete", "Step", "Linear", "Quadratic", "Cubic"}
    moments = [datetime.fromisoformat(each) for each in geometry["datetimes"]]
    assert len(moments) == len(geometry["coordinates"]) > 0
    assert all(before < after for before, after in itertools.pairwise(moments))
    for lon, lat in geometry["coordinates"]:
        assert -180 <= lon <= 180
        assert -90 <= lat <= 90
    return moments


@both
async def test_moving_features_are_as_the_standard_says(stored):
    files, manifest, _ = await export(stored, format="mfjson")
    collection = json.loads(files["window.mf.json"])
    verdicts = [each["properties"] for each in collection["features"] if each["properties"]["kind"] == "verdict"]
    assert {each["outcome"]: each["verified"] for each in verdicts} == {"verified": True, "refuted": False}
    assert collection["type"] == "FeatureCollection"
    assert collection["crs"]["type"] == "Name"
    assert collection["trs"]["type"] in {"Name", "Link"}
    moving = {}
    for feature in collection["features"]:
        assert feature["type"] == "Feature"
        geometry = feature["temporalGeometry"]
        parts = geometry["prisms"] if geometry["type"] == "MovingGeometryCollection" else [geometry]
        moments = [moment for part in parts for moment in require_moving_point(part)]
        assert moments == sorted(set(moments))
        for values in feature.get("temporalProperties", []):
            for name, measure in values.items():
                if name != "datetimes":
                    assert measure["type"] == "Measure"
                    assert measure["form"].startswith("http")
                    assert len(measure["values"]) == len(values["datetimes"])
        kind = feature["properties"]["kind"]
        moving.setdefault(kind, []).append((feature["id"], len(moments)))
    assert sorted(moving["claimed"]) == [("uav-1", 5), ("uav-2", 1)]
    assert [count for _, count in moving["estimate"]] == [5]
    assert [count for _, count in moving["verdict"]] == [1, 1]
    assert manifest["counts"]["left_out_same_moment"] == 1, "at one moment a point is at one place; the count says so"


async def test_filters_by_drone_pad_and_area(stored):
    async def claimed(**query):
        files, _, _ = await export(stored, format="csv", **query)
        rows = list(csv.DictReader(io.StringIO(files["claimed.csv"].decode())))
        return sorted((row["uav_id"], row["pad_id"]) for row in rows)

    assert await claimed(drone="uav-2") == [("uav-2", "pad-2")]
    assert await claimed(pad="pad-1") == [("uav-1", "pad-1")]
    area = {"south_e7": -1, "north_e7": 1, "west_e7": 222_000_000, "east_e7": 223_000_000}
    assert await claimed(area=area) == [("uav-2", "pad-2")]
    assert await claimed(from_ms=START_MS + 4_000) == [("uav-1", "pad-2")]


def test_an_area_may_lie_across_the_date_line():
    area = ExportArea(south_e7=0, north_e7=10, west_e7=1_790_000_000, east_e7=-1_790_000_000)
    assert area.holds(5, 1_799_999_999)
    assert area.holds(5, -1_799_999_999)
    assert not area.holds(5, 0)
    assert not area.holds(11, 1_799_999_999)


async def test_it_is_audited_and_fetched_once_by_whoever_asked(stored, clock):
    asked = (await stored.http.post("/api/v1/exports", json=WINDOW | {"format": "csv"})).json()
    async with stored.context.database.read() as database:
        (row,) = await database.scalars(select(AuditRow).where(AuditRow.act == "export"))
    assert row.subject == f"export/{asked['export_id']}"
    assert json.loads(row.detail)["format"] == "csv"
    cookies = dict(stored.http.cookies)
    token = await stored.parts.sign_ins.new_token("Another", ("inspector",))
    stored.http.cookies.clear()
    assert (await stored.http.post("/api/v1/session", json={"token": token})).status_code == 200
    other = await stored.get(f"/exports/{asked['export_id']}/file")
    stored.http.cookies.clear()
    stored.http.cookies.update(cookies)
    first = await stored.get(f"/exports/{asked['export_id']}/file")
    again = await stored.get(f"/exports/{asked['export_id']}/file")
    assert [first.status_code, again.status_code] == [200, 409]
    assert other.status_code == 404, "nobody else's"
    late = (await stored.http.post("/api/v1/exports", json=WINDOW | {"format": "csv"})).json()
    clock.now_ms += 3_600_001
    assert (await stored.get(f"/exports/{late['export_id']}/file")).status_code == 404


async def test_who_only_looks_takes_nothing_away(running):
    token = await running.parts.sign_ins.new_token("Viewer", ("viewer",))
    running.http.cookies.clear()
    assert (await running.http.post("/api/v1/session", json={"token": token})).status_code == 200
    answer = await running.http.post("/api/v1/exports", json=WINDOW | {"format": "csv"})
    assert answer.status_code == 403
    assert (await running.get("/replay/state", params={"at_ms": START_MS})).status_code == 200


@pytest.mark.parametrize(
    ("body", "path"),
    [
        ({"format": "kml"}, "body.format"),
        ({"format": "csv", "until_ms": START_MS}, "body"),
        ({"format": "csv", "drone": "../x"}, "body.drone"),
        ({"format": "csv", "area": {"south_e7": 5, "north_e7": 4, "west_e7": 0, "east_e7": 0}}, "body.area"),
        ({"format": "csv", "sql": "1"}, "body.sql"),
    ],
)
async def test_what_cannot_be_meant_is_refused_by_name(running, body, path):
    answer = await running.http.post("/api/v1/exports", json=WINDOW | body)
    assert answer.status_code == 422
    assert path in [each["path"] for each in answer.json()["errors"]]


async def test_more_than_an_export_may_hold_is_refused_before_it_begins(running):
    running.context.settings.__dict__["export_max_rows"] = 2
    answer = await running.http.post("/api/v1/exports", json=WINDOW | {"format": "csv"})
    assert answer.status_code == 201, "as many as it may"
    running.context.settings.__dict__["export_max_rows"] = 1
    answer = await running.http.post("/api/v1/exports", json=WINDOW | {"format": "csv"})
    assert answer.status_code == 400
    assert "shorter" in answer.json()["detail"]
    async with running.context.database.read() as database:
        assert (
            await database.execute(select(func.count()).select_from(AuditRow).where(AuditRow.act == "export"))
        ).scalar_one() == 1


async def test_one_alone_does_not_take_every_place(stored):
    asked = (await stored.http.post("/api/v1/exports", json=WINDOW | {"format": "csv"})).json()
    others = [(await stored.http.post("/api/v1/exports", json=WINDOW | {"format": "csv"})).json() for _ in range(2)]
    under_way = ExportRow.export_id.in_([each["export_id"] for each in others])
    async with stored.context.database.write() as connection:
        await connection.execute(update(ExportRow).where(under_way).values(state="running"))
    refused = await stored.get(f"/exports/{asked['export_id']}/file")
    assert (refused.status_code, refused.headers["retry-after"]) == (429, "10")
    async with stored.context.database.write() as connection:
        await connection.execute(update(ExportRow).where(under_way).values(person_id="another"))
    assert (await stored.get(f"/exports/{asked['export_id']}/file")).status_code == 200


async def test_a_format_that_is_switched_off(new_backend, serving):
    async with serving(new_backend(outputs={"exports": ["csv"]})) as client:
        refused = await client.http.post("/api/v1/exports", json=WINDOW | {"format": "mfjson"})
        assert (refused.status_code, refused.json()["type"]) == (404, "urn:wonderland:problem:switched-off")
        assert "outputs.exports" in refused.json()["detail"]
        assert (await client.http.post("/api/v1/exports", json=WINDOW | {"format": "csv"})).status_code == 201
        assert (await client.json("/status"))["server"]["outputs"]["exports"] == ["csv"]
