"""The enumerations of ASTM F3411-22a, tables 4–8, and what the accuracy classes mean in units.

A value that is not listed here is reserved, and a message that carries one is refused.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final


class ProtocolVersion(IntEnum):
    """The low half of a message's first byte."""

    F3411_19 = 0
    EN_4709_002 = 1
    F3411_22A = 2


class MessageType(IntEnum):
    """The high half of a message's first byte."""

    BASIC_ID = 0
    LOCATION = 1
    AUTHENTICATION = 2
    SELF_ID = 3
    SYSTEM = 4
    OPERATOR_ID = 5
    PACK = 15


class IdType(IntEnum):
    """What kind of identifier a Basic ID carries."""

    NONE = 0
    SERIAL_NUMBER = 1
    CAA_REGISTRATION = 2
    UTM_UUID = 3
    SPECIFIC_SESSION = 4


class UaType(IntEnum):
    """What kind of aircraft it is."""

    NONE = 0
    AEROPLANE = 1
    HELICOPTER_OR_MULTIROTOR = 2
    GYROPLANE = 3
    HYBRID_LIFT = 4
    ORNITHOPTER = 5
    GLIDER = 6
    KITE = 7
    FREE_BALLOON = 8
    CAPTIVE_BALLOON = 9
    AIRSHIP = 10
    FREE_FALL_OR_PARACHUTE = 11
    ROCKET = 12
    TETHERED_POWERED_AIRCRAFT = 13
    GROUND_OBSTACLE = 14
    OTHER = 15


class OperationalStatus(IntEnum):
    """What the aircraft says that it is doing."""

    UNDECLARED = 0
    GROUND = 1
    AIRBORNE = 2
    EMERGENCY = 3
    REMOTE_ID_SYSTEM_FAILURE = 4


class HeightReference(IntEnum):
    """What a height is measured from."""

    TAKEOFF = 0
    GROUND = 1


class HorizontalAccuracy(IntEnum):
    """Bound of the horizontal position's error, 95 %."""

    UNKNOWN = 0
    NM_10 = 1
    NM_4 = 2
    NM_2 = 3
    NM_1 = 4
    NM_0_5 = 5
    NM_0_3 = 6
    NM_0_1 = 7
    NM_0_05 = 8
    M_30 = 9
    M_10 = 10
    M_3 = 11
    M_1 = 12

    @property
    def mm(self) -> int | None:
        """The bound in millimetres; None when unknown."""
        return _HORIZONTAL_MM[self]

    @classmethod
    def of_mm(cls, accuracy_mm: int | None) -> HorizontalAccuracy:
        """The narrowest class that holds an accuracy; UNKNOWN where none does."""
        return cls(_class_of(accuracy_mm, _HORIZONTAL_MM))


class VerticalAccuracy(IntEnum):
    """Bound of an altitude's error, 95 %."""

    UNKNOWN = 0
    M_150 = 1
    M_45 = 2
    M_25 = 3
    M_10 = 4
    M_3 = 5
    M_1 = 6

    @property
    def mm(self) -> int | None:
        """The bound in millimetres; None when unknown."""
        return _VERTICAL_MM[self]

    @classmethod
    def of_mm(cls, accuracy_mm: int | None) -> VerticalAccuracy:
        """The narrowest class that holds an accuracy; UNKNOWN where none does."""
        return cls(_class_of(accuracy_mm, _VERTICAL_MM))


class SpeedAccuracy(IntEnum):
    """Bound of the horizontal speed's error, 95 %."""

    UNKNOWN = 0
    M_S_10 = 1
    M_S_3 = 2
    M_S_1 = 3
    M_S_0_3 = 4

    @property
    def mm_s(self) -> int | None:
        """The bound in millimetres per second; None when unknown."""
        return _SPEED_MM_S[self]

    @classmethod
    def of_mm_s(cls, accuracy_mm_s: int | None) -> SpeedAccuracy:
        """The narrowest class that holds an accuracy; UNKNOWN where none does."""
        return cls(_class_of(accuracy_mm_s, _SPEED_MM_S))


class AuthenticationType(IntEnum):
    """What an authentication message proves; 10–15 are for private use."""

    NONE = 0
    UAS_ID_SIGNATURE = 1
    OPERATOR_ID_SIGNATURE = 2
    MESSAGE_SET_SIGNATURE = 3
    NETWORK_REMOTE_ID = 4
    SPECIFIC_AUTHENTICATION = 5
    PRIVATE_A = 10
    PRIVATE_B = 11
    PRIVATE_C = 12
    PRIVATE_D = 13
    PRIVATE_E = 14
    PRIVATE_F = 15


class DescriptionType(IntEnum):
    """What the text of a Self ID is; 201–255 are for private use and stay plain integers."""

    TEXT = 0
    EMERGENCY = 1
    EXTENDED_STATUS = 2


class OperatorLocationType(IntEnum):
    """What the operator's position in a System message is."""

    TAKEOFF = 0
    LIVE_GNSS = 1
    FIXED = 2


class ClassificationType(IntEnum):
    """Whose classification of the aircraft follows."""

    UNDECLARED = 0
    EU = 1


class CategoryEu(IntEnum):
    """Category of the operation (EU 2019/947)."""

    UNDECLARED = 0
    OPEN = 1
    SPECIFIC = 2
    CERTIFIED = 3


class ClassEu(IntEnum):
    """Class of the aircraft (EU 2019/945)."""

    UNDECLARED = 0
    C0 = 1
    C1 = 2
    C2 = 3
    C3 = 4
    C4 = 5
    C5 = 6
    C6 = 7


PRIVATE_USE: Final = range(201, 256)
"""Description and operator-id types that nobody standardises."""

# One nautical mile is 1852 m; the classes are listed from the vaguest to the narrowest.
_HORIZONTAL_MM: Final = (
    None, 18_520_000, 7_408_000, 3_704_000, 1_852_000, 926_000, 555_600, 185_200, 92_600, 30_000, 10_000, 3_000, 1_000,
)  # fmt: skip
_VERTICAL_MM: Final = (None, 150_000, 45_000, 25_000, 10_000, 3_000, 1_000)
_SPEED_MM_S: Final = (None, 10_000, 3_000, 1_000, 300)


def _class_of(accuracy: int | None, bounds: tuple[int | None, ...]) -> int:
    if accuracy is None or accuracy <= 0:
        return 0
    for number in range(len(bounds) - 1, 0, -1):
        bound = bounds[number]
        if bound is not None and accuracy <= bound:
            return number
    return 0
