"""What is told outside, how often, and as which Cursor-on-Target events."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import pytest

from wonderland_backend.errors import SettingsError
from wonderland_backend.outputs import cot
from wonderland_backend.outputs.items import Gate, Item, items_of
from wonderland_backend.settings import load
from wonderland_backend.settings.outputs import KINDS

TRACK = {
    "uav_id": "SERIAL1",
    "lat_e7": 604_518_000,
    "lon_e7": 222_666_000,
    "height_mm": 36_120,
    "accuracy_mm": 3_000,
    "speed_mm_s": 4_250,
    "track_cdeg": 27_050,
    "operator_id": "FIN87astrdge12k8",
    "t_ms": 1_800_000_000_000,
}
ESTIMATE = {
    "uav_id": "SERIAL1",
    "lat_e7": 604_518_100,
    "lon_e7": 222_666_100,
    "ee_mm2": 10_000,
    "en_mm2": 0,
    "nn_mm2": 40_000,
    "t_ms": 1_800_000_000_100,
}
PLACE = {"lat_e7": 604_518_200, "lon_e7": 222_666_200, "height_mm": 33_000}
VERDICT = {
    "uav_id": "SERIAL1",
    "pad_id": "pad-1",
    "session_id": "5" * 64,
    "tx_id": "7" * 64,
    "block": 7,
    "tx_index": 0,
    "action": "land",
    "outcome": "refuted",
    "permission": "refused",
    "assurance": 2,
    "decided_ms": 1_800_000_001_000,
    "signed": {"claim": {**PLACE, "lat_e7": 604_519_000}},
    "estimate": PLACE,
    "covariance": {"ee_mm2": 400, "en_mm2": 0, "nn_mm2": 400},
    "reasons": [{"code": "claim_contradicted", "facts": {"said": "8.9 m from <where> it says\x07"}}],
}
NOW_MS = 1_800_000_002_000


def parsed(item):
    return ET.fromstring(cot.event(item, NOW_MS))


def test_a_frame_gives_claims_estimates_and_verdicts_apart_without_personal_data():
    found = list(items_of({"verdicts": [VERDICT], "tracks": [TRACK], "estimates": [ESTIMATE], "pads": [{}]}))
    assert [(item.kind, item.t_ms) for item in found] == [
        ("claim", TRACK["t_ms"]),
        ("estimate", ESTIMATE["t_ms"]),
        ("verdict", VERDICT["decided_ms"]),
    ]
    assert [item.to_json()["verified"] for item in found] == [False, False, False], "the verdict is a refutation"
    good = Item("verdict", "SERIAL1", 0, VERDICT | {"outcome": "verified"})
    assert good.to_json()["verified"] is True
    assert parsed(good).find("detail/__wonderland").get("verified") == "true"
    assert "operator_id" not in found[0].to_json()


def test_positions_have_a_pace_and_verdicts_are_told_once_each():
    gate = Gate(frozenset(KINDS), 1_000)

    def told(item):
        through = gate.lets_through(item)
        if through:
            gate.note_told(item)
        return through

    def claim(t_ms, uav_id="SERIAL1"):
        return told(Item("claim", uav_id, t_ms, TRACK))

    assert [claim(t_ms) for t_ms in (0, 400, 999, 1_000, 1_500, 2_100)] == [True, False, False, True, False, True]
    assert claim(2_200, "SERIAL2")
    assert claim(1_000), "a drone whose clock was set back is not silenced"

    def verdict(block, tx_index):
        return told(Item("verdict", "SERIAL1", 0, VERDICT | {"block": block, "tx_index": tx_index}))

    assert [verdict(*place) for place in ((7, 0), (7, 1), (7, 0), (6, 9), (8, 0))] == [True, True, False, False, True]
    assert not Gate(frozenset({"verdict"}), 0).lets_through(Item("claim", "SERIAL1", 0, TRACK))


def test_a_claim_stays_unknown_to_tak_and_keeps_its_own_words():
    event = parsed(Item("claim", "SERIAL1", TRACK["t_ms"], TRACK))
    assert (event.tag, event.get("version"), event.get("type"), event.get("how")) == (
        "event",
        "2.0",
        "a-u-A-C-H-q",
        "m-g",
    )
    assert (event.get("uid"), event.get("start")) == ("wonderland.SERIAL1.claim", "2027-01-15T08:00:00.000Z")
    assert event.get("stale") > event.get("time") > event.get("start")
    point = event.find("point").attrib
    assert point == {"lat": "60.4518000", "lon": "22.2666000", "hae": "36.12", "ce": "3.00", "le": "9999999.0"}
    assert event.find("detail/track").attrib == {"speed": "4.25", "course": "270.50"}
    assert event.find("detail/__wonderland").get("verified") == "false"


@pytest.mark.parametrize(
    ("ua_type", "kind"), [(0, "H-q"), (1, "F-q"), (2, "H-q"), (4, "H-q"), (6, "F-q"), (8, "L"), (10, "L"), (15, "H-q")]
)
def test_a_drone_is_civil_and_of_the_kind_that_it_says(ua_type, kind):
    event = parsed(Item("claim", "SERIAL1", 0, TRACK | {"ua_type": ua_type, "height_accuracy_mm": 10_000}))
    assert event.get("type") == f"a-u-A-C-{kind}"
    assert event.find("point").get("le") == "10.00"


def test_an_estimate_says_how_sure_it_is():
    event = parsed(Item("estimate", "SERIAL1", ESTIMATE["t_ms"], ESTIMATE))
    assert event.get("uid") == "wonderland.SERIAL1.estimate"
    assert event.find("point").get("ce") == "0.49"  # 0.2 m × 2.448
    assert event.find("point").get("hae") == cot.UNKNOWN


def test_a_verdict_marks_the_place_where_the_drone_was_found():
    event = parsed(Item("verdict", "SERIAL1", VERDICT["decided_ms"], VERDICT))
    assert (event.get("type"), event.find("point").get("lat")) == ("b-m-p-s-m", "60.4518200")
    own = event.find("detail/__wonderland").attrib
    assert (own["outcome"], own["tx_id"], own["verified"]) == ("refuted", "7" * 64, "false")
    assert "8.9 m from <where> it says" in event.find("detail/remarks").text
    assert event.find("detail/link").get("uid") == "wonderland.SERIAL1.claim"
    nowhere = {name: value for name, value in VERDICT.items() if name not in {"signed", "estimate"}}
    assert cot.event(Item("verdict", "SERIAL1", 0, nowhere), NOW_MS) is None


@pytest.mark.parametrize(
    ("setting", "value", "says"),
    [
        ("TAK__URL", "http://example.test:1", "tak.url"),
        ("TAK__URL", "tls://example.test:8089", "tls_certificate"),
        ("MQTT__HOST", "mqtt://example.test", "mqtt.host"),
        ("MQTT__PREFIX", "a/#", "mqtt"),
        ("EXPORTS", '["kml"]', "exports"),
    ],
)
def test_settings_that_cannot_work_are_refused_at_the_start(monkeypatch, setting, value, says):
    monkeypatch.setenv(f"WONDERLAND_BACKEND_OUTPUTS__{setting}", value)
    with pytest.raises(SettingsError, match=says):
        load()
