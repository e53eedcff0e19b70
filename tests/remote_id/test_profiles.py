"""What the EU and the US ask for beyond the format: each rule broken once, and complete broadcasts that break none."""

from __future__ import annotations

from dataclasses import replace

import pytest

from wonderland_remote_id import (
    Authentication,
    AuthenticationType,
    BasicId,
    CategoryEu,
    ClassEu,
    ClassificationType,
    FieldError,
    HorizontalAccuracy,
    IdType,
    Location,
    OperationalStatus,
    OperatorId,
    OperatorLocationType,
    ProtocolVersion,
    SelfId,
    System,
    VerticalAccuracy,
)
from wonderland_remote_id.operators import check_character, check_operator_id
from wonderland_remote_id.profiles import Profile, Severity, check_message, check_set
from wonderland_remote_id.serials import parse_serial_number

SERIAL = BasicId(uas_id="1581F5FKD229400A1234")
PLACE = Location(
    lat_e7=604_518_000, lon_e7=222_666_000, status=OperationalStatus.AIRBORNE, track_cdeg=9_000, speed_mm_s=2_500,
    vertical_mm_s=0, altitude_mm=40_000, height_mm=12_000, horizontal_accuracy=HorizontalAccuracy.M_10,
    vertical_accuracy=VerticalAccuracy.M_10, after_hour_ms=1_000,
)  # fmt: skip
SYSTEM = System(
    operator_lat_e7=604_518_000, operator_lon_e7=222_666_000, operator_location=OperatorLocationType.LIVE_GNSS,
    classification=ClassificationType.EU, category=CategoryEu.OPEN, uas_class=ClassEu.C2, operator_altitude_mm=10_000,
    t_ms=1_800_000_000_000,
)  # fmt: skip
OPERATOR = OperatorId(operator_id="FIN87astrdge12k8")


def rules(message, profile) -> set[str]:
    return {violation.rule for violation in check_message(message, profile)}


def test_a_complete_broadcast_breaks_nothing() -> None:
    assert check_set((SERIAL, PLACE, SYSTEM, OPERATOR), Profile.EU) == ()
    assert check_set((SERIAL, PLACE, SYSTEM), Profile.US) == ()


@pytest.mark.parametrize(
    ("message", "rule"),
    [
        (replace(SERIAL, version=ProtocolVersion.F3411_19), "eu.version"),
        (replace(SERIAL, uas_id="short"), "eu.serial.malformed"),
        (replace(PLACE, lat_e7=None, lon_e7=None), "eu.position.missing"),
        (replace(PLACE, height_mm=None), "eu.height.missing"),
        (replace(PLACE, speed_mm_s=None), "eu.speed.missing"),
        (replace(PLACE, track_cdeg=None), "eu.track.missing"),
        (replace(PLACE, after_hour_ms=None), "eu.time.missing"),
        (replace(PLACE, status=OperationalStatus.UNDECLARED), "eu.status.undeclared"),
        (replace(SYSTEM, operator_lat_e7=None, operator_lon_e7=None), "eu.operator_position.missing"),
        (replace(SYSTEM, category=CategoryEu.UNDECLARED), "eu.category.undeclared"),
        (replace(SYSTEM, uas_class=ClassEu.UNDECLARED), "eu.class.undeclared"),
        (replace(SYSTEM, classification=ClassificationType.UNDECLARED), "eu.classification"),
        (System(operator_lat_e7=1, operator_lon_e7=1, t_ms=1_800_000_000_000), "eu.classification.undeclared"),
        (replace(SYSTEM, t_ms=None), "eu.system_time.missing"),
        (OperatorId(operator_id="FIN87astrdge12k8-xyz"), "eu.operator_id.secret"),
        (OperatorId(operator_id="12345"), "eu.operator_id.malformed"),
        (replace(OPERATOR, operator_id_type=201), "eu.operator_id.type"),
        (
            Authentication(authentication_type=AuthenticationType.UAS_ID_SIGNATURE, page=1, data=bytes(23)),
            "eu.authentication",
        ),
    ],
)
def test_eu(message, rule) -> None:
    assert rules(message, Profile.EU) == {rule}


@pytest.mark.parametrize(
    ("message", "rule"),
    [
        (replace(SERIAL, version=ProtocolVersion.EN_4709_002), "us.version"),
        (replace(SERIAL, uas_id="1581G"), "us.serial.malformed"),
        (replace(PLACE, lat_e7=None, lon_e7=None), "us.position.missing"),
        (replace(PLACE, altitude_mm=None), "us.altitude.missing"),
        (replace(PLACE, vertical_mm_s=None), "us.velocity.missing"),
        (replace(PLACE, after_hour_ms=None), "us.time.missing"),
        (replace(PLACE, horizontal_accuracy=HorizontalAccuracy.NM_0_05), "us.horizontal_accuracy"),
        (replace(PLACE, vertical_accuracy=VerticalAccuracy.M_150), "us.vertical_accuracy"),
        (replace(PLACE, status=OperationalStatus.UNDECLARED), "us.status.undeclared"),
        (replace(SYSTEM, operator_lat_e7=None, operator_lon_e7=None), "us.control_station.missing"),
        (replace(SYSTEM, operator_altitude_mm=None), "us.control_station_altitude.missing"),
        (replace(SYSTEM, operator_location=OperatorLocationType.FIXED), "us.operator_location"),
        (replace(SYSTEM, t_ms=None), "us.system_time.missing"),
        (
            Authentication(authentication_type=AuthenticationType.NONE, page=1, data=bytes(23)),
            "us.authentication.none",
        ),
    ],
)
def test_us(message, rule) -> None:
    assert rules(message, Profile.US) == {rule}


def test_what_nobody_said() -> None:
    missing = {violation.rule for violation in check_set((SelfId(text="hi"),), Profile.EU)}
    assert missing == {"eu.id.missing", "eu.location.missing", "eu.system.missing", "eu.operator_id.missing"}
    registration = BasicId(uas_id="N.12345", id_type=IdType.CAA_REGISTRATION)
    assert "us.id.missing" in {violation.rule for violation in check_set((registration, PLACE, SYSTEM), Profile.US)}
    session = BasicId(uas_id="01" + 38 * "a", id_type=IdType.SPECIFIC_SESSION)
    assert check_set((session, PLACE, SYSTEM), Profile.US) == ()


def test_the_secret_is_not_repeated() -> None:
    [violation] = check_message(OperatorId(operator_id="FIN87astrdge12k8-xyz"), Profile.EU)
    assert violation.severity is Severity.REQUIRED
    assert "xyz" not in str(violation)


@pytest.mark.parametrize(
    "text", ["", "158", "1581", "15810", "1581G", "1581F5FKD", "1581FOFKD229400A1234", "I581112", "15811a"]
)
def test_serial_numbers_that_are_none(text) -> None:
    with pytest.raises(FieldError):
        parse_serial_number(text)


def test_serial_number() -> None:
    assert parse_serial_number("1581F5FKD229400A1234").serial == "5FKD229400A1234"
    assert parse_serial_number("MFR11Z").manufacturer == "MFR1"


def test_operator_numbers() -> None:
    # The example of EASA's guidance: FIN 87astrdge12k 8, secret xyz.
    assert check_character("87astrdge12kxyz") == "8"
    assert check_operator_id("FIN87astrdge12k8-xyz") == "FIN87astrdge12k8"
    for wrong in ("FIN87astrdge12k9-xyz", "FIN87astrdge12k8-xyy", "FIN87astrdge12k8", "fin87astrdge12k8-xyz", ""):
        with pytest.raises(FieldError) as caught:
            check_operator_id(wrong)
        assert "xy" not in str(caught.value)
    with pytest.raises(FieldError):
        check_character("Ä")
