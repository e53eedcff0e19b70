"""Windows of the past for machines: by a scope of their own, as much as their role shows, not as often as they like."""

from __future__ import annotations

import asyncio
import io
import json
import zipfile

import httpx
import pytest

from wonderland.client import ApiError, Wonderland

START_MS = 1_800_000_000_000
WINDOW = {"from_ms": START_MS, "until_ms": START_MS + 60_000}
TRACK = {
    "uav_id": "uav-1", "lat_e7": 604_518_000, "lon_e7": 222_666_000, "transport": "wifi_beacon",
    "operator_id": "FIN87astrdge12k8",
}  # fmt: skip


@pytest.fixture
async def heard(running, agent_client):
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()
        assert (await agent.report(("track", TRACK), t_ms=START_MS + 1_000))["type"] == "ack"
    return running


async def export(http, **query):
    """The archive's files, as text."""
    asked = await http.post("/api/v1/exports", json=WINDOW | query)
    assert asked.status_code == 201, asked.text
    answer = await http.get(f"/api/v1/exports/{asked.json()['export_id']}/file")
    assert answer.status_code == 200, answer.text
    packed = zipfile.ZipFile(io.BytesIO(answer.content))
    return {name: packed.read(name).decode() for name in packed.namelist()}


@pytest.mark.parametrize(
    ("kind", "name"), [("geojson", "window.geojson"), ("csv", "claimed.csv"), ("mfjson", "window.mf.json")]
)
async def test_a_machine_gets_a_window_without_personal_data(heard, machine, kind, name):
    async with machine("wonderland.exports", role="inspector") as http:
        files = await export(http, format=kind)
    assert "uav-1" in files[name]
    assert "FIN87" not in "".join(files.values())


async def test_only_its_scope_opens_it_and_only_to_whoever_asked(heard, machine):
    async with machine("wonderland.tracks.read wonderland.proofs.read") as http:
        refused = await http.post("/api/v1/exports", json=WINDOW | {"format": "csv"})
        assert (refused.status_code, refused.json()["type"]) == (403, "urn:wonderland:problem:insufficient-scope")
    async with machine("wonderland.exports") as http, machine("wonderland.exports") as other:
        export_id = (await http.post("/api/v1/exports", json=WINDOW | {"format": "csv"})).json()["export_id"]
        assert (await other.get(f"/api/v1/exports/{export_id}")).status_code == 404
        assert (await other.get(f"/api/v1/exports/{export_id}/file")).status_code == 404
        assert (await http.get("/api/v1/tracks")).status_code == 403


async def test_a_machine_of_an_organisation_gets_its_own(heard, machine):
    async with machine("wonderland.exports", role="pad_operator", msp_id="NobodyMSP") as http:
        asked = await http.post("/api/v1/exports", json=WINDOW | {"format": "geojson", "drone": "uav-1"})
        assert asked.json()["expected"] == 0, "nor is it told how much others have"
        files = await export(http, format="geojson")
    assert json.loads(files["window.geojson"])["features"] == []


async def test_not_as_often_and_not_as_much_as_it_likes(new_backend, serving, chain, facts, source_of, machine_at):
    chain.add(facts.put_pad(), facts.put_uav(), facts.request("one"))
    chain.add(facts.decide("one"), facts.decide("two"))
    options = {"client_exports_per_min": 2, "export_max_rows": 1}
    async with serving(new_backend(source_of(chain), **options)) as client:
        await client.mirrored(chain.height)
        async with machine_at(client, "wonderland.exports") as http:
            much = await http.post("/api/v1/exports", json=WINDOW | {"format": "csv"})
            assert much.status_code == 400, "two rows, and one is the most"
            assert "shorter" in much.json()["detail"]
            less = WINDOW | {"format": "csv", "until_ms": START_MS + 1}
            assert (await http.post("/api/v1/exports", json=less)).status_code == 201
            often = await http.post("/api/v1/exports", json=less)
            assert often.status_code == 429
            assert int(often.headers["retry-after"]) > 0


async def test_by_the_python_client(heard, register, tmp_path):
    row, secret = await register(heard, "wonderland.exports")
    with Wonderland(heard.url, row.client_id, secret, http=httpx.Client(trust_env=False)) as api:

        def fetch():
            with (tmp_path / "window.zip").open("wb") as file:
                return api.export(file, "mfjson", START_MS, START_MS + 60_000, drone="uav-1")

        made = await asyncio.to_thread(fetch)
        assert made["state"] == "done"
        assert json.loads(zipfile.ZipFile(tmp_path / "window.zip").read("window.mf.json"))["features"]
        with pytest.raises(ApiError, match="no such export"):
            await asyncio.to_thread(api._transport.download, f"/exports/{'0' * 32}/file", io.BytesIO())
