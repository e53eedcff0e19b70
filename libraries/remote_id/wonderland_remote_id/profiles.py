"""What the law asks of a broadcast beyond the standard's format: the rules of the EU and of the US, rule by rule.

A message can be perfect ASTM F3411-22a and yet break EN 4709-002 (EU) or 14 CFR part 89 with ASTM F3586-22 (US).
`check_message` judges one message by itself, `check_set` what a drone's messages say and omit together (a pack, or
what was heard of one transmitter for three seconds). Neither raises; each violation is named.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Final

from wonderland_remote_id.enums import (
    AuthenticationType,
    CategoryEu,
    ClassEu,
    ClassificationType,
    HorizontalAccuracy,
    IdType,
    OperationalStatus,
    OperatorLocationType,
    ProtocolVersion,
    VerticalAccuracy,
)
from wonderland_remote_id.errors import FieldError
from wonderland_remote_id.messages import (
    Authentication,
    BasicId,
    Location,
    Message,
    OperatorId,
    System,
)
from wonderland_remote_id.operators import is_european_operator_id, public_operator_id
from wonderland_remote_id.serials import parse_serial_number


class Profile(Enum):
    """Whose rules hold: EN 4709-002 with EU 2019/945, or 14 CFR part 89 with ASTM F3586-22."""

    EU = "eu"
    US = "us"


class Severity(Enum):
    """``REQUIRED``: the broadcast breaks a rule; ``RECOMMENDED``: it omits what the standard advises."""

    REQUIRED = "required"
    RECOMMENDED = "recommended"


@dataclass(frozen=True, slots=True)
class Violation:
    """One rule that is not kept: its name (``eu.height.missing``), how much it weighs, and what was found."""

    rule: str
    message: str
    severity: Severity = Severity.REQUIRED


# 14 CFR 89.310: 100 ft horizontally, 150 ft vertically, with 95 % probability; the classes that hold these.
_US_HORIZONTAL: Final = HorizontalAccuracy.M_30
_US_VERTICAL: Final = VerticalAccuracy.M_45


def check_message(message: Message, profile: Profile) -> tuple[Violation, ...]:
    """The rules that one message breaks by what it says."""
    rules = _eu if profile is Profile.EU else _us
    return tuple(rules(message))


def check_set(messages: Iterable[Message], profile: Profile) -> tuple[Violation, ...]:
    """The rules that a drone's messages break together: each one's own, and what nobody said."""
    known = tuple(messages)
    found = [violation for message in known for violation in check_message(message, profile)]
    name = profile.value
    if not any(isinstance(message, BasicId) and _names(message, profile) for message in known):
        asked = "a serial number" if profile is Profile.EU else "a serial number or a session id"
        found.append(Violation(f"{name}.id.missing", f"no Basic ID with {asked}"))
    if not any(isinstance(message, Location) for message in known):
        found.append(Violation(f"{name}.location.missing", "no Location message"))
    if not any(isinstance(message, System) for message in known):
        whose = "the operator's position, or the take-off's" if profile is Profile.EU else "the control station"
        found.append(Violation(f"{name}.system.missing", f"no System message: {whose} is missing"))
    if profile is Profile.EU and not any(isinstance(message, OperatorId) for message in known):
        found.append(Violation("eu.operator_id.missing", "no Operator ID: the registration number is missing"))
    return tuple(found)


def _names(message: BasicId, profile: Profile) -> bool:
    if profile is Profile.EU:
        return message.id_type is IdType.SERIAL_NUMBER
    return message.id_type in {IdType.SERIAL_NUMBER, IdType.UTM_UUID, IdType.SPECIFIC_SESSION}


def _serial(message: BasicId, profile: Profile) -> Iterator[Violation]:
    if message.id_type is IdType.SERIAL_NUMBER:
        try:
            parse_serial_number(message.uas_id)
        except FieldError as error:
            yield Violation(f"{profile.value}.serial.malformed", f"ANSI/CTA-2063-A: {error.message}")


def _eu(message: Message) -> Iterator[Violation]:
    if message.version is ProtocolVersion.F3411_19:
        yield Violation("eu.version", "protocol version 0 (F3411-19) is older than EN 4709-002")
    if isinstance(message, BasicId):
        yield from _serial(message, Profile.EU)
    elif isinstance(message, Location):
        yield from _eu_location(message)
    elif isinstance(message, System):
        yield from _eu_system(message)
    elif isinstance(message, OperatorId):
        text = message.operator_id.strip()
        if public_operator_id(text) != text:
            # The text itself is not repeated: that would spread the secret further.
            yield Violation("eu.operator_id.secret", "the three secret characters of the registration are broadcast")
        elif not is_european_operator_id(text):
            yield Violation("eu.operator_id.malformed", "is not country (3 capitals), 12 characters, check character")
        if message.operator_id_type:
            yield Violation("eu.operator_id.type", f"type {message.operator_id_type} is private; the EU uses 0")
    elif isinstance(message, Authentication):
        yield Violation("eu.authentication", "the EU's rules have no authentication", Severity.RECOMMENDED)


def _eu_location(message: Location) -> Iterator[Violation]:
    if message.lat_e7 is None:
        yield Violation("eu.position.missing", "latitude and longitude are unknown")
    if message.height_mm is None:
        yield Violation("eu.height.missing", "the height above the take-off or the surface is unknown")
    if message.speed_mm_s is None:
        yield Violation("eu.speed.missing", "the ground speed is unknown")
    if message.track_cdeg is None:
        yield Violation("eu.track.missing", "the course over ground is unknown")
    if message.after_hour_ms is None:
        yield Violation("eu.time.missing", "the time of the position is unknown")
    if message.status is OperationalStatus.UNDECLARED:
        yield Violation("eu.status.undeclared", "the status is undeclared", Severity.RECOMMENDED)


def _eu_system(message: System) -> Iterator[Violation]:
    if message.operator_lat_e7 is None:
        yield Violation("eu.operator_position.missing", "neither the operator's position nor the take-off's is known")
    if message.classification is ClassificationType.EU:
        if message.category is CategoryEu.UNDECLARED:
            yield Violation("eu.category.undeclared", "the category is undeclared", Severity.RECOMMENDED)
        if message.uas_class is ClassEu.UNDECLARED:
            yield Violation("eu.class.undeclared", "the class is undeclared", Severity.RECOMMENDED)
    elif message.category is not CategoryEu.UNDECLARED or message.uas_class is not ClassEu.UNDECLARED:
        yield Violation("eu.classification", "has an EU category or class, but does not say that they are the EU's")
    else:
        yield Violation("eu.classification.undeclared", "category and class are not declared", Severity.RECOMMENDED)
    if message.version is ProtocolVersion.F3411_22A and message.t_ms is None:
        yield Violation("eu.system_time.missing", "the time is missing, which protocol version 2 asks for")


def _us(message: Message) -> Iterator[Violation]:
    if message.version is not ProtocolVersion.F3411_22A:
        yield Violation("us.version", f"protocol version {int(message.version)}; F3586-22 asks for 2 (F3411-22a)")
    if isinstance(message, BasicId):
        yield from _serial(message, Profile.US)
    elif isinstance(message, Location):
        yield from _us_location(message)
    elif isinstance(message, System):
        if message.operator_lat_e7 is None:
            yield Violation("us.control_station.missing", "the control station's position is unknown")
        if message.operator_altitude_mm is None:
            yield Violation("us.control_station_altitude.missing", "its geometric altitude is unknown")
        if message.operator_location is OperatorLocationType.FIXED:
            yield Violation(
                "us.operator_location", "a fixed position is neither the control station's nor the take-off's"
            )
        if message.t_ms is None:
            yield Violation("us.system_time.missing", "the time is missing")
    elif isinstance(message, Authentication) and message.authentication_type is AuthenticationType.NONE:
        yield Violation("us.authentication.none", "an authentication message of type none", Severity.RECOMMENDED)


def _us_location(message: Location) -> Iterator[Violation]:
    if message.lat_e7 is None:
        yield Violation("us.position.missing", "latitude and longitude are unknown")
    if message.altitude_mm is None:
        yield Violation("us.altitude.missing", "the geometric altitude is unknown")
    if message.speed_mm_s is None or message.track_cdeg is None or message.vertical_mm_s is None:
        yield Violation("us.velocity.missing", "speed, course or vertical speed is unknown")
    if message.after_hour_ms is None:
        yield Violation("us.time.missing", "the time mark is unknown")
    if message.horizontal_accuracy < _US_HORIZONTAL:
        yield Violation("us.horizontal_accuracy", "the class of the horizontal accuracy is wider than 30 m (100 ft)")
    if message.vertical_accuracy < _US_VERTICAL:
        yield Violation("us.vertical_accuracy", "the class of the vertical accuracy is wider than 45 m (150 ft)")
    if message.status is OperationalStatus.UNDECLARED:
        yield Violation("us.status.undeclared", "the emergency status is undeclared")
