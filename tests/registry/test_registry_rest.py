"""The registry's lists, history and organisations, on SQLite and PostgreSQL, from a chain of real blocks."""

from __future__ import annotations

import pytest
from kit.backend import serving
from kit.chain import Source
from kit.facts import START_MS, Facts

from wonderland.proofs.records.calibrations import Calibration

BOTH = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)


@pytest.fixture
async def client(new_backend, chain):
    facts = Facts()
    chain.add(facts.put_pad(), facts.put_pad("pad-2", commissioned=False), facts.put_uav(), facts.put_uav("uav-2"))
    chain.add(facts.grant(), facts.set_policy())
    chain.add(
        facts.put_uav("uav-2", status="suspended", status_reason="why"), facts.put_uav("uav-3", model="Räven 100%")
    )
    async with serving(new_backend(Source(chain))) as running:
        await running.mirrored(chain.height)
        yield running


@BOTH
async def test_lists_are_found_filtered_sorted_and_paged(client):
    ids = lambda found: [each["record"]["uav_id"] for each in found["items"]]  # noqa: E731 - said once, used below
    assert ids(await client.json("/registry/drones")) == ["uav-1", "uav-2", "uav-3"]
    assert ids(await client.json("/registry/drones", status="suspended")) == ["uav-2"]
    assert ids(await client.json("/registry/drones", q="ven 100%")) == ["uav-3"]
    assert ids(await client.json("/registry/drones", q="UAV-2")) == ["uav-2"]
    assert ids(await client.json("/registry/drones", q="%")) == ["uav-3"]
    assert ids(await client.json("/registry/drones", msp="NoMSP")) == []
    seen, cursor = [], None
    for _ in range(3):
        more = {"cursor": cursor} if cursor else {}
        found = await client.json("/registry/drones", sort="changed", limit=1, **more)
        seen += ids(found)
        cursor = found.get("next")
    assert (sorted(seen), seen[0] in {"uav-2", "uav-3"}, cursor) == (["uav-1", "uav-2", "uav-3"], True, None)
    pads = await client.json("/registry/pads", q="pad-2")
    assert [each["record"]["pad_id"] for each in pads["items"]] == ["pad-2"]
    assert (await client.get("/registry/drones", params={"colour": "red"})).status_code == 422
    assert (await client.get("/registry/drones", params={"cursor": "x"})).status_code == 400


async def test_a_drone_with_its_calibrations(new_backend, chain):
    facts = Facts()
    pad = facts.put_pad()
    digest = facts.pad().commissioning_sha256

    def at(pad_id, **more):
        record = {"pad_id": pad_id, "commissioning_sha256": digest, "offset_mm": 300, "sigma_mm": 20, "sessions": 2}
        record |= {"rounds": 60, "measured_ms": START_MS - 1_000, "valid_until_ms": START_MS + 10**12}
        record |= {"registered_ms": START_MS, "registered_by": "olga", "msp_id": "PadMSP"} | more
        return Calibration.parse(record).to_json()

    calibrations = (
        at("pad-1"),
        at("pad-2", commissioning_sha256="1" * 64),
        at("pad-3", withdrawn="another antenna"),
        at("pad-4", valid_until_ms=START_MS - 10**11),
    )
    others = [facts.put_pad(f"pad-{number}") for number in (2, 3, 4)]
    chain.add(pad, *others, facts.put_uav(), facts.put_uav("uav-2", calibrations=calibrations))
    async with serving(new_backend(Source(chain))) as running:
        await running.mirrored(chain.height)
        assert (await running.json("/registry/drones/uav-1"))["calibrations"] == []
        found = (await running.json("/registry/drones/uav-2"))["calibrations"]
    assert [each["state"] for each in found] == ["holds", "pad_changed", "withdrawn", "over"]
    assert [each["record"] for each in found] == list(calibrations)


@BOTH
async def test_a_drone_with_its_versions_and_history(client):
    found = await client.json("/registry/drones/uav-2")
    assert found["drone"]["version"] == {"block": 3, "tx_index": 0}
    history = await client.json("/registry/history", kind="drone", id="uav-2")
    last, first = history["items"]
    assert (last["record"]["status"], last["before"]["status"]) == ("suspended", "active")
    assert "before" not in first
    assert (last["block"], first["block"]) == (3, 1)
    granted = await client.json("/registry/history", kind="drone", id="uav-1", limit=1)
    assert granted["items"][0]["kind"] == "authorisation"
    rest = await client.json("/registry/history", kind="drone", id="uav-1", cursor=granted["next"])
    assert [each["kind"] for each in rest["items"]] == ["drone"]
    assert (await client.get("/registry/history", params={"kind": "drone", "id": "none"})).status_code == 404


@BOTH
async def test_a_pad_with_policies_and_reach(client):
    found = await client.json("/registry/pads/pad-1")
    assert [each["set_for"] for each in found["policies"]] == ["*/*"] * 4
    assert {each["policy"]["buffer_mm"] for each in found["policies"]} == {2_000}
    distances = [each["distance_mm"] for each in found["reach"]]
    assert distances == sorted(distances)
    common = await client.json("/registry/policies")
    assert [each["own"] for each in common["policies"]] == [True, False, False, False]
    assert (await client.json("/registry/pads/pad-2"))["reach"] == []


@BOTH
async def test_organisations_and_certificates(client):
    organisations = {each["msp_id"]: each for each in (await client.json("/registry/organisations"))["items"]}
    assert organisations["PadMSP"]["pads"] == 2
    assert organisations["PadMSP"]["authorities"][0]["serial"]
    certificates = (await client.json("/registry/certificates"))["items"]
    assert certificates
    assert {each["state"] for each in certificates} <= {"valid", "expiring", "expired"}
    one = certificates[0]
    assert one in (await client.json("/registry/certificates", q=one["name"], msp=one["msp_id"]))["items"]
    forms = (await client.json("/registry/forms"))["items"]
    assert {"SetUavStatus", "ProposePolicy", "ApproveChange"} <= {each["function"] for each in forms}
