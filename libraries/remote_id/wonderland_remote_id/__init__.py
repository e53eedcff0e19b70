"""Broadcast Remote ID (ASTM F3411-22a, EN 4709-002): a codec without input or output.

``decode(frame)`` gives a message or a pack, ``encode`` the frame of one; both raise `RemoteIdError` and nothing else.
``decode_tolerant`` keeps what can be read of a bad frame and names its faults; ``to_json`` and ``from_json`` are the
messages as JSON objects, ``check_message`` and ``check_set`` the rules of the EU and the US. ``framings`` holds the
wrappings in which frames arrive. Nothing outside the standard library is needed.

>>> frame = encode(BasicId(uas_id="1581F5FKD229400A1234", ua_type=UaType.HELICOPTER_OR_MULTIROTOR))
>>> len(frame), decode(frame).uas_id
(25, '1581F5FKD229400A1234')
"""

from wonderland_remote_id.decoding import MAX_FRAME_BYTES, decode
from wonderland_remote_id.encoding import encode
from wonderland_remote_id.enums import (
    AuthenticationType,
    CategoryEu,
    ClassEu,
    ClassificationType,
    DescriptionType,
    HeightReference,
    HorizontalAccuracy,
    IdType,
    MessageType,
    OperationalStatus,
    OperatorLocationType,
    ProtocolVersion,
    SpeedAccuracy,
    UaType,
    VerticalAccuracy,
)
from wonderland_remote_id.errors import (
    FieldError,
    FrameLengthError,
    FramingError,
    MessageTypeError,
    PackError,
    ProtocolVersionError,
    RemoteIdError,
)
from wonderland_remote_id.json_form import from_json, to_json
from wonderland_remote_id.messages import (
    Authentication,
    BasicId,
    Location,
    Message,
    OperatorId,
    Pack,
    SelfId,
    System,
    resolve_time,
)
from wonderland_remote_id.operators import check_operator_id, public_operator_id
from wonderland_remote_id.profiles import Profile, Severity, Violation, check_message, check_set
from wonderland_remote_id.serials import SerialNumber, parse_serial_number
from wonderland_remote_id.tolerant import Problem, Tolerated, decode_tolerant

__all__ = [
    "MAX_FRAME_BYTES",
    "Authentication",
    "AuthenticationType",
    "BasicId",
    "CategoryEu",
    "ClassEu",
    "ClassificationType",
    "DescriptionType",
    "FieldError",
    "FrameLengthError",
    "FramingError",
    "HeightReference",
    "HorizontalAccuracy",
    "IdType",
    "Location",
    "Message",
    "MessageType",
    "MessageTypeError",
    "OperationalStatus",
    "OperatorId",
    "OperatorLocationType",
    "Pack",
    "PackError",
    "Problem",
    "Profile",
    "ProtocolVersion",
    "ProtocolVersionError",
    "RemoteIdError",
    "SelfId",
    "SerialNumber",
    "Severity",
    "SpeedAccuracy",
    "System",
    "Tolerated",
    "UaType",
    "VerticalAccuracy",
    "Violation",
    "check_message",
    "check_operator_id",
    "check_set",
    "decode",
    "decode_tolerant",
    "encode",
    "from_json",
    "parse_serial_number",
    "public_operator_id",
    "resolve_time",
    "to_json",
]
