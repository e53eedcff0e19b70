"""What ED-318 and ED-269 have in common: texts, authorities, times. Results are as ED-318 writes them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime
from typing import Any, Final

from wonderland_backend.zones.files.node import Node

TYPES: Final = ("USPACE", "PROHIBITED", "REQ_AUTHORIZATION", "CONDITIONAL", "NO_RESTRICTION")
VARIANTS: Final = ("COMMON", "CUSTOMIZED")
REASONS: Final = (
    "AIR_TRAFFIC", "SENSITIVE", "PRIVACY", "POPULATION", "NATURE", "NOISE", "EMERGENCY", "DAR", "OTHER",
)  # fmt: skip
ROLES: Final = ("AUTHORIZATION", "NOTIFICATION", "INFORMATION")
DAYS: Final = ("MON", "TUE", "WED", "THU", "FRI", "SAT", "SUN", "ANY")
EVENTS: Final = ("BMCT", "SR", "SS", "EECT")
YES_NO: Final = ("YES", "NO")
SHORT, LANGUAGE = 200, 5
MAX_TEXTS: Final = 40
MAX_PERIODS: Final = 100
MAX_REGION: Final = 2**31
IDENTIFIER: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._+-]{0,6}")
COUNTRY: Final = re.compile(r"[A-Z]{3}")

_DATE_TIME: Final = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{1,9})?(Z|[+-]\d\d:\d\d)", re.IGNORECASE)
_TIME: Final = re.compile(r"([01]\d|2[0-4]):([0-5]\d)(?::([0-5]\d)(?:\.\d{1,9})?)?(Z|z|[+-](?:[01]\d|2[0-3]):[0-5]\d)")
_DURATION: Final = re.compile(r"P(?=.)(\d+Y)?(\d+M)?(\d+W)?(\d+D)?(T(?=.)(\d+H)?(\d+M)?(\d+S)?)?")
_EMAIL: Final = re.compile(r"[^@\s]{1,64}@[^@\s]{1,190}")
_URL: Final = re.compile(r"https?://[^\s/]\S{0,500}")

Json = dict[str, Any]


def set_if(document: Json, name: str, value: object) -> None:
    """Put a member that there is."""
    if value is not None:
        document[name] = value


def texts(node: Node | None, maximum: int = SHORT) -> list[Json] | None:
    """A list of texts with their languages."""
    if node is None:
        return None
    found = []
    for each in node.items(0, MAX_TEXTS):
        if not each.is_object():
            continue
        lang = each.need("lang")
        language = lang.text(LANGUAGE, 1) if lang is not None else None
        said = each.maybe("text")
        text = said.text(maximum) if said is not None else ""
        if language is not None and text:
            found.append({"text": text, "lang": language})
    return found


def identity(node: Node) -> tuple[str | None, str | None]:
    """(identifier, country)."""
    identifier = node.need("identifier")
    name = identifier.text(7, 1) if identifier is not None else None
    if name is not None and identifier is not None and IDENTIFIER.fullmatch(name) is None:
        identifier.error(f"{name!r}: letters, digits, space and . _ + - only, the first a letter or digit")
        name = None
    country = node.need("country")
    code = country.text(3, 3) if country is not None else None
    if code is not None and country is not None and COUNTRY.fullmatch(code) is None:
        country.error(f"{code!r} is no ISO 3166-1 alpha-3 code; write three capital letters, for example FIN")
        code = None
    return name, code


def contact(node: Node, document: Json) -> None:
    """E-mail, address and telephone of an authority, its role, and how long before it wants to be asked."""
    purpose = node.need("purpose")
    if purpose is not None:
        set_if(document, "purpose", purpose.choice(ROLES))
    for name, pattern, advice in (
        ("email", _EMAIL, "an address such as name@example.org"),
        ("siteURL", _URL, "an address that begins with https:// or http://"),
        ("intervalBefore", _DURATION, "an ISO 8601 duration such as P2D or PT6H"),
    ):
        member = node.maybe(name)
        if member is None or member.value == "":
            continue
        text = member.text(600)
        if text is not None and pattern.fullmatch(text) is None:
            member.error(f"{text[:60]!r}: expected {advice}")
        else:
            set_if(document, name, text)
    phone = node.maybe("phone")
    if phone is not None and phone.value != "":
        set_if(document, "phone", phone.text(SHORT))


def period(node: Node) -> Json:
    """One period of applicability: between two times, and within that by a schedule."""
    document: Json = {}
    times = []
    for name in ("startDateTime", "endDateTime"):
        member = node.maybe(name)
        if member is not None:
            text = date_time(member)
            set_if(document, name, text)
            times.append(text)
    if len(times) == 2 and times[0] and times[1] and moment(times[0]) >= moment(times[1]):
        node.at("endDateTime").error("the period ends before it begins")
    schedule = node.maybe("schedule")
    if schedule is not None:
        days = [_daily(each) for each in schedule.items(0, MAX_PERIODS) if each.is_object()]
        if days:
            document["schedule"] = days
    return document


def date_time(node: Node) -> str | None:
    """A date and time with its offset from UTC (RFC 3339)."""
    text = node.text(40)
    if text is None:
        return None
    try:
        if _DATE_TIME.fullmatch(text) is not None and datetime.fromisoformat(_micro(text)).year > 1:
            return text
    except ValueError:
        pass
    node.error(f"{text!r} is no date and time such as 2026-06-01T08:00:00Z; the Z, or an offset, must be there")
    return None


def moment(text: str) -> datetime:
    """The moment that a checked date and time means."""
    return datetime.fromisoformat(_micro(text))


def _micro(text: str) -> str:
    """Python reads at most six digits of a second's fraction."""
    return re.sub(r"(\.\d{6})\d+", r"\1", text.upper())


def _daily(node: Node) -> Json:
    node.known(("day", "startTime", "startEvent", "endTime", "endEvent"), "a schedule has day, start and end")
    document: Json = {}
    day = node.need("day")
    if day is not None:
        document["day"] = [each for item in day.items(1, 8) if (each := item.choice(DAYS)) is not None]
    for edge in ("start", "end"):
        time, event = node.maybe(f"{edge}Time"), node.maybe(f"{edge}Event")
        if time is not None and event is not None:
            node.error(f"both {edge}Time and {edge}Event; keep the one that is meant")
        elif event is not None:
            set_if(document, f"{edge}Event", event.choice(EVENTS))
        elif time is not None:
            set_if(document, f"{edge}Time", _time(time))
    return document


def _time(node: Node) -> str | None:
    text = node.text(40)
    if text is None:
        return None
    match = _TIME.fullmatch(text)
    if match is None or (match[1] == "24" and (match[2], match[3] or "00") != ("00", "00")):
        node.error(f"{text!r} is no time such as 08:00:00Z; the Z, or an offset such as +02:00, must be there")
        return None
    return f"{match[1]}:{match[2]}:{match[3] or '00'}{match[4].upper()}"


def reasons(node: Node | None, renamed: dict[str, str]) -> list[str] | None:
    """Why the zone is there; `renamed` gives older names, with a notice."""
    if node is None:
        return None
    return list(dict.fromkeys(_reasons(node, renamed)))


def _reasons(node: Node, renamed: dict[str, str]) -> Iterator[str]:
    for each in node.items(0, len(REASONS) + len(renamed)):
        if isinstance(each.value, str) and each.value in renamed:
            each.notice(f"{each.value} is unknown to ED-318; taken as {renamed[each.value]}")
            yield renamed[each.value]
        elif (reason := each.choice(REASONS)) is not None:
            yield reason
