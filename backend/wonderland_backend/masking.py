"""Personal data of operators: shown in part, until somebody who may asks for it with a reason.

An operator's registration number (EU 2019/947, article 14) may be that of a natural person; so may the operator id of a
drone's record, and the number that a drone broadcasts. Of the first the ledger has a commitment only: the number itself
comes from `wonderland_backend.numbers`.
"""

from __future__ import annotations

from typing import Any, Final

import orjson

from wonderland_backend.person import Person

HIDDEN: Final = "---"
"""In letters that a registration number may have, so that what is shown is a record of the same shape."""
_HEAD, _TAIL = 3, 2


def masked(value: str) -> str:
    """The country and what tells two apart on one screen: FIN---k8."""
    if len(value) < 2 * (_HEAD + _TAIL):
        return HIDDEN
    return f"{value[:_HEAD]}{HIDDEN}{value[-_TAIL:]}"


def sees_clearly(person: Person, msp_id: str) -> bool:
    """Whether these are the data of somebody's own organisation."""
    return person.has("fleet_operator") and bool(msp_id) and person.msp_id == msp_id


def shown_uav(record: str, person: Person) -> str:
    """A drone's record (JSON text) as this person sees it."""
    document: dict[str, Any] = orjson.loads(record)
    before = dict(document)
    _mask(document, person, document.get("msp_id", ""))
    return record if document == before else orjson.dumps(document).decode()


def is_drone(record: dict[str, Any]) -> bool:
    """Whether it is a drone's record, or the argument that registers one; a pad's operator is no secret."""
    return isinstance(record.get("uav_id"), str) and isinstance(record.get("operator_id"), str)


def shown_json(text: str, person: Person, owner: str = "") -> str:
    """What stands on the ledger (an argument, a record, an event) as this person sees it.

    Drones' records may be anywhere in it; `owner` is whose those are that do not say it. All else stays as it is.
    """
    try:
        document = orjson.loads(text)
    except orjson.JSONDecodeError:
        return text
    changed, waiting = False, [document]
    while waiting:
        each = waiting.pop()
        if isinstance(each, dict):
            if is_drone(each):
                before = dict(each)
                _mask(each, person, each.get("msp_id", owner))
                changed |= each != before
            waiting += each.values()
        elif isinstance(each, list):
            waiting += each
    return orjson.dumps(document).decode() if changed else text


def _mask(uav: dict[str, Any], person: Person, owner: str) -> None:
    """A drone's record, or the argument that registers it, in place."""
    if sees_clearly(person, owner):
        return
    if not person.has("admin", "inspector") and uav.get("operator_id"):
        uav["operator_id"] = masked(uav["operator_id"])


def shown_alert(alert: dict[str, Any], person: Person) -> dict[str, Any]:
    """An alert as this person sees it: who only looks does not learn who did what about it."""
    return alert if _knows_names(person) else without_names(alert)


def without_names(alert: dict[str, Any]) -> dict[str, Any]:
    """An alert for those who only look."""
    return alert | {name: HIDDEN for name in ("acknowledged_by", "assigned_to") if name in alert}


def shown_act(act: dict[str, Any], person: Person) -> dict[str, Any]:
    """What was done about an alert, in the same way: notes may name people."""
    if _knows_names(person):
        return act
    hidden = {"person", "note"} | ({"detail"} if act["act"] == "assign" else set())
    return act | {name: HIDDEN for name in hidden if name in act}


def _knows_names(person: Person) -> bool:
    return person.has("admin", "inspector", "pad_operator", "fleet_operator")
