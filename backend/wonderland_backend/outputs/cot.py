"""Cursor-on-Target events, as TAK clients read them. Pure.

Source: MITRE "Cursor-on-Target Message Router User's Guide" (event schema 2.0); the types are those of MIL-STD-2525B as
TAK uses them. A drone's claim and the pad's estimate are air tracks of their own; a verdict is a mark at the place that
it is about. A claim stays "unknown" whatever the verdict says: a reader must see what was claimed and what was found.
"""

from __future__ import annotations

import datetime as dt
from typing import Any, Final
from xml.etree import ElementTree as ET

from wonderland_backend.outputs.items import Item
from wonderland_backend.proofs.reasons import reasons_in
from wonderland_backend.settings.outputs import Kind
from wonderland_remote_id.enums import UaType

DRONE: Final = "a-u-A-C-H-q"
"""Atom, unknown affiliation, air, civil, rotary wing, unmanned: q is TAK's letter for the civil Q of MIL-STD-2525."""
FIXED_WING: Final = "a-u-A-C-F-q"
LIGHTER_THAN_AIR: Final = "a-u-A-C-L"
_TYPES: Final = {
    **dict.fromkeys((UaType.AEROPLANE, UaType.ORNITHOPTER, UaType.GLIDER), FIXED_WING),
    **dict.fromkeys((UaType.FREE_BALLOON, UaType.CAPTIVE_BALLOON, UaType.AIRSHIP), LIGHTER_THAN_AIR),
}
MARK: Final = "b-m-p-s-m"
FROM_GNSS: Final = "m-g"
FUSED: Final = "m-f"
UNKNOWN: Final = "9999999.0"
E7: Final = 1e7
_COLOURS: Final = {"verified": -16711936, "inconclusive": -256, "refuted": -65536}
"""ARGB as TAK writes it: a signed 32-bit number."""
_STALE_MS: Final[dict[Kind, int]] = {"claim": 10_000, "estimate": 5_000, "verdict": 15 * 60_000}
_SIGMAS_95: Final = 2.4477
"""Radius of the circle that holds 95 % of a circular two-dimensional normal distribution, in σ: √(−2 ln 0.05)."""


def event(item: Item, now_ms: int) -> bytes | None:
    """The event of an item; None for a verdict that has no place."""
    if item.kind == "verdict":
        return _verdict(item, now_ms)
    accuracy_mm = item.body.get("accuracy_mm") if item.kind == "claim" else _radius_95_mm(item.body)
    kind = _TYPES.get(item.body.get("ua_type", UaType.NONE), DRONE)
    root = _event(item, now_ms, kind, FROM_GNSS if item.kind == "claim" else FUSED, item.body, accuracy_mm)
    detail = ET.SubElement(root, "detail")
    ET.SubElement(detail, "contact", callsign=f"{item.uav_id} {'claimed' if item.kind == 'claim' else 'measured'}")
    if "speed_mm_s" in item.body and "track_cdeg" in item.body:
        speed, course = item.body["speed_mm_s"] / 1000, item.body["track_cdeg"] / 100
        ET.SubElement(detail, "track", speed=f"{speed:.2f}", course=f"{course:.2f}")
    _own(detail, item, {})
    words = "as the drone broadcasts it by Remote ID" if item.kind == "claim" else "as a pad ranges it, not yet decided"
    ET.SubElement(detail, "remarks").text = f"Position {words}; unverified."
    return _encoded(root)


def _verdict(item: Item, now_ms: int) -> bytes | None:
    body = item.body
    claim = (body.get("signed") or body.get("broadcast") or {}).get("claim")
    place = body.get("estimate") or claim
    if place is None:
        return None
    root = _event(item, now_ms, MARK, FUSED, place, _radius_95_mm(body.get("covariance") or {}))
    detail = ET.SubElement(root, "detail")
    outcome = body["outcome"]
    ET.SubElement(detail, "contact", callsign=f"{item.uav_id} {outcome}")
    colour = str(_COLOURS[outcome])
    ET.SubElement(detail, "color", argb=colour)
    ET.SubElement(detail, "usericon", iconsetpath=f"COT_MAPPING_SPOTMAP/{MARK}/{colour}")
    if claim is not None:
        ET.SubElement(detail, "link", uid=_uid(item.uav_id, "claim"), relation="p-p", type=DRONE)
    names = ("outcome", "permission", "action", "pad_id", "assurance", "session_id", "tx_id", "block")
    _own(detail, item, {name: str(body[name]) for name in names})
    reasons = "; ".join(each["text"] for each in reasons_in("en", body.get("reasons", [])))
    ET.SubElement(detail, "remarks").text = _clean(
        f"{outcome.capitalize()} at pad {body['pad_id']}, {body['action']} {body['permission']}. {reasons}"
    )
    return _encoded(root)


def _event(item: Item, now_ms: int, kind: str, how: str, place: dict[str, Any], accuracy_mm: int | None) -> ET.Element:
    root = ET.Element(
        "event",
        version="2.0",
        uid=_uid(item.uav_id, item.kind),
        type=kind,
        how=how,
        time=_time(now_ms),
        start=_time(item.t_ms),
        stale=_time(max(now_ms, item.t_ms) + _STALE_MS[item.kind]),
    )
    height_mm, height_accuracy_mm = place.get("height_mm"), place.get("height_accuracy_mm")
    ET.SubElement(
        root,
        "point",
        lat=f"{place['lat_e7'] / E7:.7f}",
        lon=f"{place['lon_e7'] / E7:.7f}",
        hae=UNKNOWN if height_mm is None else f"{height_mm / 1000:.2f}",
        ce=UNKNOWN if accuracy_mm is None else f"{accuracy_mm / 1000:.2f}",
        le=UNKNOWN if height_mm is None or height_accuracy_mm is None else f"{height_accuracy_mm / 1000:.2f}",
    )
    return root


def _own(detail: ET.Element, item: Item, more: dict[str, str]) -> None:
    """What TAK has no word for, under a name of our own, which readers that do not know it pass over."""
    content = {"kind": item.kind, "uav_id": item.uav_id, "verified": str(item.verified).lower(), **more}
    ET.SubElement(detail, "__wonderland", {name: _clean(value) for name, value in content.items()})


def _uid(uav_id: str, kind: Kind) -> str:
    return f"wonderland.{uav_id}.{kind}"


def _radius_95_mm(covariance: dict[str, Any]) -> int | None:
    """A circle about the estimate that holds 95 %: that of the larger semi-axis."""
    if not {"ee_mm2", "en_mm2", "nn_mm2"} <= covariance.keys():
        return None
    ee, en, nn = covariance["ee_mm2"], covariance["en_mm2"], covariance["nn_mm2"]
    largest = (ee + nn) / 2 + (((ee - nn) / 2) ** 2 + en**2) ** 0.5
    return int(_SIGMAS_95 * max(largest, 0.0) ** 0.5)


def _time(t_ms: int) -> str:
    moment = dt.datetime.fromtimestamp(t_ms / 1000, dt.UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _clean(text: str) -> str:
    """Characters that XML 1.0 cannot hold are left out."""
    return (
        "".join(letter for letter in text if letter in "\t\n" or letter >= " ")
        .replace("\ufffe", "")
        .replace("\uffff", "")
    )


def _encoded(root: ET.Element) -> bytes:
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text
