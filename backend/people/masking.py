"""Personal data of operators: shown in part, until somebody who may asks for it with a reason.

A drone's `registration` is its operator's registration number (EU 2019/947, article 14), which may be that of a
natural person; so is the operator id that a drone broadcasts.
"""

from __future__ import annotations

from typing import Any, Final

import orjson

from backend.auth.person import Person
from wonderland.proofs.records.uavs import without_secret

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
    number = document.get("registration", "")
    public = without_secret(number)
    if public != number:
        document["registration"] = public
    if sees_clearly(person, document.get("msp_id", "")):
        return record if public == number else orjson.dumps(document).decode()
    if document.get("registration"):
        document["registration"] = masked(document["registration"])
    if not person.has("admin", "inspector") and document.get("operator_id"):
        document["operator_id"] = masked(document["operator_id"])
    return orjson.dumps(document).decode()


def shown_event(payload: str, person: Person) -> str:
    """The payload of a contract's event as this person sees it; what is not of a drone stays as it is."""
    try:
        event = orjson.loads(payload)
    except orjson.JSONDecodeError:
        return payload
    record = event.get("record") if isinstance(event, dict) else None
    if not isinstance(record, dict) or not isinstance(record.get("registration"), str):
        return payload
    event["record"] = orjson.loads(shown_uav(orjson.dumps(record).decode(), person))
    return orjson.dumps(event).decode()


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
