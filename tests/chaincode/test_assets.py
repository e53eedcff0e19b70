from __future__ import annotations

import hashlib

from wonderland.proofs import encoding

POSE = '{"header":{"frame_id":"map"},"pose":{"position":{"x":1.5e-3}},"covariance":null}'


def pose(**more):
    return {"id": "uav-1/pose", "type": "geometry_msgs/msg/PoseStamped", "media_type": "application/json"} | more


def test_any_message_is_created_edited_read_and_deleted(empty):
    """The value holds floats and null, which no record may: the contract never looks inside."""
    created = empty.call(empty.uav, "CreateAsset", pose(value=POSE))
    assert created == pose(
        value=POSE,
        owner_msp="FleetMSP",
        owner="uav-1",
        version=1,
        created_ms=empty.start_ms,
        updated_ms=empty.start_ms,
    )
    assert empty.call(empty.mirror, "ReadAsset", id="uav-1/pose") == created
    name, payload = empty.events[-1]
    assert name == "AssetCreated"
    assert "value" not in payload["record"]
    assert payload["record"]["value_sha256"] == hashlib.sha256(POSE.encode()).hexdigest()

    empty.now_ms += 10
    updated = empty.call(empty.uav, "UpdateAsset", id="uav-1/pose", value="AAEC", media_type="application/cdr")
    assert updated == created | {
        "value": "AAEC",
        "media_type": "application/cdr",
        "version": 2,
        "updated_ms": empty.now_ms,
    }
    assert empty.events[-1][0] == "AssetUpdated"
    empty.now_ms += 10
    assert empty.call(empty.uav, "DeleteAsset", id="uav-1/pose") == {"id": "uav-1/pose", "deleted": True}
    assert empty.events[-1][0] == "AssetDeleted"
    assert empty.events[-1][1]["record"]["version"] == 2
    empty.refuse(404, "ASSET_UNKNOWN", empty.mirror, "ReadAsset", id="uav-1/pose")

    answer = empty.call(empty.inspector, "AssetHistory", id="uav-1/pose")
    assert [change["deleted"] for change in answer["changes"]] == [True, False, False]
    assert [change.get("asset") for change in answer["changes"]] == [None, updated, created]
    assert [change["t_ms"] for change in answer["changes"]] == [empty.now_ms, empty.now_ms - 10, empty.start_ms]
    assert answer["more"] is False


def test_who_may_change_an_asset(empty):
    empty.call(empty.uav, "CreateAsset", pose(value="1"))
    for who in (empty.fleet, empty.inspector, empty.person(empty.uav, msp_id="PadMSP")):
        empty.refuse(403, "ASSET_OF_OTHER_OWNER", who, "UpdateAsset", id="uav-1/pose", value="2")
        empty.refuse(403, "ASSET_OF_OTHER_OWNER", who, "DeleteAsset", id="uav-1/pose")
    changed = empty.call(empty.admin, "UpdateAsset", id="uav-1/pose", value="2")
    assert changed["owner"] == "uav-1"
    empty.call(empty.uav, "DeleteAsset", id="uav-1/pose")


def test_assets_are_unique_and_known(empty):
    empty.call(empty.uav, "CreateAsset", pose(value="1"))
    empty.refuse(409, "ASSET_EXISTS", empty.pad, "CreateAsset", pose(value="2"))
    for function, more in (("UpdateAsset", {"value": "2"}), ("DeleteAsset", {}), ("AssetHistory", {})):
        empty.refuse(404, "ASSET_UNKNOWN", empty.uav, function, id="nothing", **more)
    nameless = empty.person(empty.uav, common_name="")
    empty.refuse(403, "IDENTITY_WITHOUT_NAME", nameless, "CreateAsset", pose(id="x", value=""))


def test_a_deleted_asset_may_be_made_again_by_another(empty):
    empty.call(empty.uav, "CreateAsset", pose(value="1"))
    empty.call(empty.uav, "DeleteAsset", id="uav-1/pose")
    again = empty.call(empty.pad, "CreateAsset", pose(value="2"))
    assert (again["version"], again["owner"]) == (1, "pad-1")


def test_the_largest_value_comes_back_and_larger_ones_are_refused(empty):
    value = "ä" * 499_800  # two bytes each
    empty.call(empty.uav, "CreateAsset", pose(value=value))
    for larger in ("ä" * 500_000, "ä" * (512 * 1024 - 200)):  # the last one's argument fills its megabyte
        empty.refuse(400, "ASSET_TOO_LARGE", empty.uav, "CreateAsset", pose(id="x", value=larger))
        empty.refuse(400, "ASSET_TOO_LARGE", empty.uav, "UpdateAsset", id="uav-1/pose", value=larger)
    assert empty.call(empty.pad, "ReadAsset", id="uav-1/pose")["value"] == value
    empty.refuse(400, "BAD_ARGUMENT", empty.uav, "CreateAsset", pose(id="x", value="a" * (512 * 1024 + 1)))
    empty.refuse(400, "BAD_ARGUMENT", empty.uav, "CreateAsset", pose(id="x", value="語" * (400 * 1024)))


def test_a_long_history_is_cut_by_number_and_by_size(empty):
    empty.call(empty.uav, "CreateAsset", pose(value="0"))
    for index in range(1, 12):
        empty.call(empty.uav, "UpdateAsset", id="uav-1/pose", value=chr(97 + index) * 400_000)
    answer = empty.call(empty.uav, "AssetHistory", id="uav-1/pose", limit=2)
    assert [change["asset"]["version"] for change in answer["changes"]] == [12, 11]
    assert answer["more"] is True
    answer = empty.call(empty.uav, "AssetHistory", id="uav-1/pose")
    assert answer["more"] is True
    assert 1 < len(answer["changes"]) < 6
    assert len(encoding.encode(answer)) < 3 << 20
    assert empty.last is not None
    assert empty.last.reads == len(answer["changes"]) + 1
