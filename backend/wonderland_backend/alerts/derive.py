"""Alerts that follow from the ledger alone: made in the mirror's own database transaction, so that none is lost."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, Final

import orjson

from wonderland_backend.alerts.kinds import Alert
from wonderland_backend.mirror.derive import LandingTold
from wonderland_backend.mirror.rows import VerdictWrite


def _refutation(record: dict[str, Any]) -> tuple[str, int | None]:
    """By what a verdict refuted: (kind of alert, how far off the claim is)."""
    differences = record.get("time_differences") or record.get("witness") or {}
    signed, broadcast = record.get("signed") or {}, record.get("broadcast") or {}
    if signed.get("outcome") == "refuted":
        codes = {each["code"] for each in signed.get("reasons", ())}
        # Where its ranges fit the claim, their error says nothing of why it was refuted.
        if "outside_buffer" not in codes:
            if "time_differences_contradict" in codes:
                return "stamps_contradict", differences.get("error_mm")
            if "leaving" in codes:
                return "leaving", None
        return "refuted", signed.get("error_mm")
    if broadcast.get("outcome") in _OWN_LIE:
        return "broadcast_contradicts", broadcast.get("error_mm")
    # The two-way ranges agree with the claim, and what needs no word of the drone's clock does not: it bent its own.
    return "stamps_contradict", differences.get("error_mm")


_OWN_LIE: Final = frozenset({"own_contradicted", "refuted"})
"""What the drone signed for; "refuted" in verdicts of former contracts, which took every broadcast for the drone's."""
_BY_ZONES: Final = frozenset({"zone_active", "closures_outdated"})
_BY_PAPERS: Final = ("uav_", "maintenance_", "not_authorised")


def _against(record: dict[str, Any]) -> tuple[dict[str, str], bool]:
    """Why it may not do what it asked: what closes it (empty: nothing), and whether by its papers, too."""
    zones = [each for each in record["reasons"] if each["code"] in _BY_ZONES]
    closed = {"code": zones[0]["code"], "zone_id": zones[0]["facts"].get("zone_id", "")} if zones else {}
    return closed, any(each["code"].startswith(_BY_PAPERS) for each in record["reasons"])


def _elsewhere(record: dict[str, Any]) -> bool:
    """Whether the contradicted broadcast says another place than what the drone signed and was refuted for.

    A drone that is led astray broadcasts what it signs: one alert says both.
    """
    signed, claim = record.get("signed") or {}, record["broadcast"].get("claim")
    if signed.get("outcome") != "refuted" or claim is None:
        return True
    east, north = (claim[axis] - signed["claim"][axis] for axis in ("east_mm", "north_mm"))
    return bool(math.hypot(east, north) > record["broadcast"].get("tolerance_mm", 0))


def alerts_of(verdicts: Iterable[VerdictWrite]) -> Iterator[Alert]:
    """The alerts of verdicts, in their order."""
    for row in verdicts:
        record = orjson.loads(row.record)
        place = {
            "pad_id": row.pad_id,
            "uav_id": row.uav_id,
            "session_id": row.session_id,
            "tx_id": row.tx_id,
        }
        facts: dict[str, Any] = {"action": row.action}
        if row.outcome == "refuted":
            kind, error_mm = _refutation(record)
            if kind == "stamps_contradict":
                facts["located"] = "no" if error_mm is None else "yes"
            if error_mm is not None:
                facts["error_mm"] = error_mm
            yield Alert(kind, row.session_id, row.decided_ms, **place, facts=facts)
        broadcast = record.get("broadcast") or {}
        if broadcast.get("outcome") == "contradicted" and _elsewhere(record):
            supported = "yes" if broadcast["supported"] else "no"
            facts = {"action": row.action, "error_mm": broadcast["error_mm"], "supported": supported}
            yield Alert("broadcast_unattributed", row.session_id, row.decided_ms, **place, facts=facts)
        if record.get("authorised") is False:
            closed, others = _against(record)
            if closed:
                yield Alert("zone_closed", row.session_id, row.decided_ms, **place, facts=facts | closed)
            if others or not closed:
                facts = {"action": row.action}
                yield Alert("unauthorised", row.session_id, row.decided_ms, **place, facts=facts)


def landings_of(landings: Iterable[LandingTold]) -> Iterator[Alert]:
    """The alerts of landings without permission that drones reported of themselves."""
    for told in landings:
        landing = told.landing
        place = {"pad_id": landing.pad_id, "uav_id": landing.uav_id, "tx_id": told.tx_id}
        yield Alert("landed_unpermitted", told.tx_id, landing.reported_ms, **place, facts={"cause": landing.cause})
