"""Zones by REST, on a real ledger: import, lists, the geo-awareness service, closures from the plan to the contract."""

from __future__ import annotations

import http.client
import json
from pathlib import Path

import pytest
from sqlalchemy import select

from wonderland.proofs.records.closures import Closures
from wonderland_backend.db.tables.audit import AuditRow
from wonderland_backend.zones import differing

FILES = Path(__file__).parent / "files"
TURKU = (FILES / "turku.ed318.json").read_bytes()
GEO = {"Accept": "application/geo+json"}
PAD = "aurajoki-2"


def brought(who, data, source="turku", **options):
    return who.http.post("/api/v1/zones/imports", content=data, params={"source": source, **options})


def imported(who, data=TURKU, source="turku"):
    answer = brought(who, data, source)
    assert answer.status_code == 201, answer.text
    return answer.json()


def edited(change):
    document = json.loads(TURKU)
    change(document["features"])
    return json.dumps(document).encode()


def ids(answer):
    assert answer.status_code == 200, answer.text
    return [each["zone_id"] for each in answer.json()["items"]]


def test_a_dry_run_lists_every_error_and_imports_nothing(admin):
    broken = (FILES / "broken.ed318.json").read_bytes()
    answer = brought(admin, broken, dry_run=True)
    assert answer.status_code == 200
    report = answer.json()
    assert (report["valid"], report["error_count"], report["zones"]) == (False, 16, 0)
    assert report["errors"][0]["line"] == 9
    refused = brought(admin, broken)
    assert refused.status_code == 422
    assert refused.headers["content-type"] == "application/problem+json"
    assert refused.json()["errors"][0]["path"] == "line 9: features[0].geometry.coordinates[0][0]"
    good = brought(admin, TURKU, dry_run=True).json()
    assert (good["valid"], good["zones"], good["added"], good["format"]) == (True, 3, 3, "ed318")
    assert ids(admin.get("/zones")) == []
    assert admin.get("/zones/imports").json()["items"] == []


def test_zones_are_told_as_they_were_known_at_a_time(admin):
    first = imported(admin)
    second = imported(admin, edited(lambda features: features.pop(0)))
    sets = {each["import_id"]: each for each in admin.get("/zones/imports").json()["items"]}
    began_ms, replaced_ms = sets[first["import_id"]]["imported_ms"], sets[second["import_id"]]["imported_ms"]
    assert began_ms < replaced_ms
    then = {"at_ms": replaced_ms - 1}
    assert ids(admin.get("/zones", params={"at_ms": began_ms - 1})) == []
    assert ids(admin.get("/zones", params=then)) == ["FIN:NIGHT 1", "FIN:P20", "FIN:R1"]
    assert ids(admin.get("/zones", params={"at_ms": replaced_ms})) == ids(admin.get("/zones"))
    imported_zone = next(each for each in admin.get("/zones", params=then).json()["items"] if each["limited"])
    assert imported_zone["changes_ms"] > then["at_ms"]
    page = admin.get("/zones", params={**then, "limit": 2}).json()
    assert ids(admin.get("/zones", params={**then, "limit": 2, "cursor": page["next"]})) == ["FIN:R1"]


def test_an_import_replaces_its_sources_data_set_and_keeps_the_history(house, admin):
    first = imported(admin)
    assert (first["added"], first["removed"], first["changed"]) == (3, 0, 0)
    again = brought(admin, TURKU)
    assert (again.status_code, again.json()["import_id"]) == (200, first["import_id"])
    naantali = imported(admin, (FILES / "naantali.ed269.json").read_bytes(), "naantali")
    assert naantali["format"] == "ed269"

    def change(features):
        features[0]["properties"]["message"] = []
        features[1]["properties"]["identifier"] = "R2"

    second = imported(admin, edited(change))
    assert (second["added"], second["removed"], second["changed"]) == (1, 1, 1)
    assert ids(admin.get("/zones")) == ["FIN:N1", "FIN:N2", "FIN:NIGHT 1", "FIN:P20", "FIN:R2"]
    history = admin.get("/zones/imports", params={"source": "turku"}).json()["items"]
    assert [(each["import_id"], "replaced_ms" in each, each["imported_by"]) for each in history] == [
        (second["import_id"], False, "Anna"),
        (first["import_id"], True, "Anna"),
    ]
    assert admin.get("/zones/imports", params={"current": True, "limit": 1}).json()["next"]
    emptied = imported(admin, b'{"type": "FeatureCollection", "features": []}')
    assert emptied["removed"] == 3
    assert ids(admin.get("/zones")) == ["FIN:N1", "FIN:N2"]

    async def acts():
        async with house.backend.database.read() as database:
            return (await database.execute(select(AuditRow.act, AuditRow.subject, AuditRow.person))).all()

    assert [tuple(row) for row in house.run(acts())].count(("import_zones", "zones/turku", "Anna")) == 3


def test_a_zone_cannot_be_in_two_data_sets(admin):
    imported(admin)
    report = brought(admin, TURKU, "copy", dry_run=True).json()
    assert report["errors"][0]["message"] == "zone FIN:P20 is in the data set of 'turku' already"
    assert brought(admin, TURKU, "copy").status_code == 422


def test_who_may_import_and_how_much(house, admin):
    viewer = house.person("Vera", "viewer")
    assert brought(viewer, TURKU).status_code == 403
    imported(admin)
    assert len(ids(viewer.get("/zones"))) == 3
    assert brought(admin, TURKU, "no/good").status_code == 422
    # 200 MB: refused by what the header says, before a byte of it is read.
    connection = http.client.HTTPConnection("127.0.0.1", house.port, timeout=20)
    connection.putrequest("POST", "/api/v1/zones/imports?source=turku")
    cookies = "; ".join(f"{name}={value}" for name, value in admin.http.cookies.items())
    connection.putheader("Cookie", cookies)
    connection.putheader("Content-Length", str(200 << 20))
    connection.endheaders()
    answer = connection.getresponse()
    assert answer.status == 413
    assert str(32 << 20) in json.loads(answer.read())["detail"]
    connection.close()

    def endless():
        for _ in range(40):
            yield b" " * (1 << 20)

    assert brought(admin, endless()).status_code == 413


def test_lists_by_place_type_and_time(admin):
    imported(admin)
    imported(admin, (FILES / "naantali.ed269.json").read_bytes(), "naantali")

    def listed(**filters):
        return ids(admin.get("/zones", params=filters))

    assert listed(type="PROHIBITED") == ["FIN:N2", "FIN:P20"]
    assert listed(source="naantali") == ["FIN:N1", "FIN:N2"]
    assert listed(country="SWE") == []
    assert listed(bbox="22.26,60.45,22.261,60.451") == ["FIN:NIGHT 1", "FIN:P20", "FIN:R1"]
    monday = 1_780_300_800_000  # 2026-06-01 08:00 UTC
    assert listed(since_ms=monday, until_ms=monday) == ["FIN:N1", "FIN:P20", "FIN:R1"]
    friday_night = 1_780_704_000_000  # 2026-06-06 00:00 UTC
    assert "FIN:N2" in listed(since_ms=friday_night, until_ms=friday_night)
    assert "FIN:NIGHT 1" in listed(since_ms=friday_night - 3 * 3_600_000, until_ms=friday_night)
    page = admin.get("/zones", params={"limit": 2, "since_ms": monday, "until_ms": monday}).json()
    assert [each["zone_id"] for each in page["items"]] == ["FIN:N1", "FIN:P20"]
    rest = {"limit": 2, "since_ms": monday, "until_ms": monday, "cursor": page["next"]}
    assert listed(**rest) == ["FIN:R1"]
    for bad in ({"since_ms": 1}, {"since_ms": 5, "until_ms": 1}, {"since_ms": 0, "until_ms": 2**41}, {"color": "red"}):
        assert admin.get("/zones", params=bad).status_code == 422


def test_one_zone_in_two_languages_and_as_plain_geojson(admin):
    imported(admin)
    zone = admin.get("/zones/FIN:P20", headers={"Accept-Language": "fi"})
    assert (zone.json()["name"], zone.json()["message"]) == ("Linna", "Ei lentoja linnan yllä")
    assert (zone.json()["active"], zone.json()["limited"]) == (True, False)
    assert (
        admin.get(
            "/zones/FIN:P20", headers={"If-None-Match": zone.headers["ETag"], "Accept-Language": "fi"}
        ).status_code
        == 304
    )
    assert admin.get("/zones/FIN:P20").json()["name"] == "Castle"
    circle = admin.get("/zones/FIN:R1", headers=GEO).json()
    assert circle["geometry"]["type"] == "Polygon"
    assert len(circle["geometry"]["coordinates"][0]) == 97
    assert "feature" not in circle["properties"]
    assert circle["properties"]["changes_ms"] > 0
    night = admin.get("/zones/FIN:NIGHT%201").json()
    assert night["layers"][0] == {"lower": {"metres": 300, "reference": "AMSL"}}
    assert admin.get("/zones/FIN:NONE").status_code == 404
    exported = admin.get("/zones/export", params={"source": "turku"}, headers=GEO)
    document = json.loads(TURKU)
    found = exported.json()
    assert found["metadata"] == document["metadata"]
    by_id = {each["properties"]["identifier"]: each for each in found["features"]}
    for each in document["features"]:
        assert by_id[each["properties"]["identifier"]]["properties"] == each["properties"]
    assert brought(admin, exported.content, dry_run=True).json() | {"sha256": ""} == brought(
        admin, TURKU, dry_run=True
    ).json() | {"sha256": "", "size_bytes": len(exported.content)}


def test_the_geo_awareness_service(house, admin):
    nothing = admin.get("/geo-awareness", params={"lat": 60.4518, "lon": 22.2666}).json()
    assert (nothing["zones"], nothing["data_sets"]) == ([], [])
    imported(admin)
    monday = 1_780_300_800_000
    asked = {"lat": 60.4518, "lon": 22.2666, "height_m": 60, "from_ms": monday, "until_ms": monday + 86_400_000}
    there = admin.get("/geo-awareness", params=asked).json()
    assert there["most_restrictive"] == "PROHIBITED"
    assert [(each["zone_id"], each["reaches"]) for each in there["zones"]] == [
        ("FIN:P20", "yes"), ("FIN:R1", "perhaps"), ("FIN:NIGHT 1", "perhaps"),
    ]  # fmt: skip
    assert there["zones"][1]["spans"] == [
        {"from_ms": monday, "until_ms": monday + 6 * 3_600_000},
        {"from_ms": monday + 22 * 3_600_000, "until_ms": monday + 24 * 3_600_000},
    ]
    assert [each["source"] for each in there["data_sets"]] == ["turku"]
    high = admin.get("/geo-awareness", params=asked | {"height_m": 500, "height_reference": "AGL"}).json()
    assert "FIN:P20" not in [each["zone_id"] for each in high["zones"]]
    hole = admin.get("/geo-awareness", params=asked | {"lat": 60.454, "lon": 22.263}).json()
    assert "FIN:P20" not in [each["zone_id"] for each in hole["zones"]]
    route = {"type": "LineString", "coordinates": [[22.25, 60.456], [22.28, 60.456]]}
    beside = admin.post("/geo-awareness", {"geometry": route, "from_ms": monday}).json()
    assert "FIN:P20" not in [each["zone_id"] for each in beside["zones"]]
    wide = admin.post("/geo-awareness", {"geometry": route, "from_ms": monday, "margin_m": 120}).json()
    assert wide["zones"][0]["zone_id"] == "FIN:P20"


@pytest.mark.parametrize(
    "geometry",
    [
        {},
        {"type": "Point"},
        {"type": "Point", "coordinates": [200, 0]},
        {"type": "LineString", "coordinates": [[0, 0]]},
        {"type": "LineString", "coordinates": [[0, 0], "x"]},
        {"type": "Polygon", "coordinates": [[[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]]]},
        {"type": "Circle", "coordinates": [0, 0]},
        {"type": "LineString", "coordinates": [[0, 0]] * 1001},
    ],
)
def test_geometries_that_mean_nothing(admin, geometry):
    answer = admin.post("/geo-awareness", {"geometry": geometry})
    assert answer.status_code == 400, answer.text
    assert answer.json()["errors"][0]["path"].startswith("body.geometry")


def test_closures_go_from_the_zones_to_the_ledger(house, admin):
    def pad():
        return admin.get(f"/zones/pads/{PAD}").json()

    assert (pad()["state"], pad()["zones"]) == ("open", [])
    imported(admin)
    its = pad()
    assert its["state"] == "missing"
    assert [(each["zone_id"], each["closes"], each["distance_m"]) for each in its["zones"]] == [
        ("FIN:P20", True, 0), ("FIN:R1", False, 0),
    ]  # fmt: skip
    argument = admin.get(f"/zones/pads/{PAD}/plan", params={"days": 30}).json()
    assert [each["zone_id"] for each in argument["closures"]] == ["FIN:P20"]
    done = admin.change("SetClosures", argument)
    assert done["state"] == "valid", done
    house.wait_mirrored(done["block"] + 1)
    its = pad()
    assert its["state"] == "current"
    assert its["published"]["block"] == done["block"]
    assert its["published"]["closures"] == argument["closures"]
    ledger = house.run(house.contract("mirror").evaluate("ReadClosures", json.dumps({"pad_id": PAD})))
    assert Closures.decode(ledger).valid_until_ms == argument["valid_until_ms"]
    # The data set changes: what the ledger has is no longer what follows from it.
    imported(admin, edited(lambda features: features.pop(0)))
    assert pad()["state"] == "differs"
    soon = {"pad_id": PAD, "closures": [], "valid_until_ms": house.now_ms() + 3_600_000}
    done = admin.change("SetClosures", soon)
    house.wait_mirrored(done["block"] + 1)
    assert pad()["state"] == "ending"
    listed = admin.get("/zones/pads").json()
    assert [each["pad_id"] for each in listed["items"]] == [PAD]
    assert admin.get("/zones/pads/nowhere").status_code == 404


def test_the_contract_lets_an_administrator_set_closures_and_nobody_else(house):
    ines = house.person("Ines", "inspector")
    ines.enrol("inspector", "ines")
    refused = ines.change("SetClosures", {"pad_id": PAD, "closures": [], "valid_until_ms": house.now_ms() + 10**6})
    assert refused["problem"]["code"] == "ROLE_NOT_ALLOWED"


def test_what_belongs_to_others_is_not_there(house, admin):
    imported(admin)
    olga = house.person("Olga", "pad_operator")
    assert olga.get("/zones/pads").json()["items"] == []
    assert olga.get(f"/zones/pads/{PAD}").status_code == 404
    assert len(ids(olga.get("/zones"))) == 3


def test_a_pad_whose_closures_run_out_is_an_alert(house, admin):
    done = admin.change("SetClosures", {"pad_id": PAD, "closures": [], "valid_until_ms": house.now_ms() + 3_600_000})
    house.wait_mirrored(done["block"] + 1)
    house.run(house.backend.watch.look_once())
    kinds = {each["kind"]: each for each in admin.get("/alerts").json()["items"]}
    assert kinds["closures_ending"]["pad_id"] == PAD
    done = admin.change("SetClosures", {"pad_id": PAD, "closures": [], "valid_until_ms": house.now_ms() + 10**10})
    house.wait_mirrored(done["block"] + 1)
    house.run(house.backend.watch.look_once())
    returned = admin.get("/alerts", params={"state": "returned"}).json()["items"]
    assert [each["kind"] for each in returned] == ["closures_ending"]


def test_closures_that_are_not_what_the_zones_say_are_an_alert(house, admin):
    imported(admin)
    kinds = ("closures_differ",)

    def look():
        house.run(house.backend.watch.look_once())
        found = admin.get("/alerts", params={"kind": kinds[0]}).json()["items"]
        return [(each["pad_id"], each["state"], each["facts"]["state"]) for each in found]

    assert look() == [], "whoever has just imported them is about to publish"
    clock = house.backend.context.clock
    house.backend.context.clock = lambda: clock() + differing.SETTLE_MS
    try:
        assert look() == [(PAD, "open", "missing")]
        assert look() == [(PAD, "open", "missing")]
        done = admin.change("SetClosures", admin.get(f"/zones/pads/{PAD}/plan", params={"days": 30}).json())
        house.wait_mirrored(done["block"] + 1)
        assert look() == [(PAD, "returned", "missing")]
        done = admin.change("SetClosures", {"pad_id": PAD, "closures": [], "valid_until_ms": house.now_ms() + 10**9})
        house.wait_mirrored(done["block"] + 1)
        assert sorted(look()) == [(PAD, "open", "differs"), (PAD, "returned", "missing")]
        last, first, *_ = admin.get("/registry/history", params={"kind": "pad", "id": PAD}).json()["items"]
        assert [each["kind"] for each in (last, first)] == ["closures", "closures"]
        assert (last["before"], last["record"]["closures"]) == (first["record"], [])
        assert (last["function"], "before" in first) == ("SetClosures", False)
    finally:
        house.backend.context.clock = clock
