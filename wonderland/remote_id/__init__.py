"""Broadcast Remote ID (ASTM F3411-22a, EN 4709-002): a codec without input or output.

``decode(frame)`` gives a message or a pack, ``encode`` the frame of one; both raise `RemoteIdError` and nothing else.
``framings`` holds the wrappings in which frames arrive.

>>> frame = encode(BasicId(uas_id="1581F5FKD229400A1234", ua_type=UaType.HELICOPTER_OR_MULTIROTOR))
>>> len(frame), decode(frame).uas_id
(25, '1581F5FKD229400A1234')
"""

from wonderland.remote_id.decoding import MAX_FRAME_BYTES, decode
from wonderland.remote_id.encoding import encode
from wonderland.remote_id.enums import (
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
from wonderland.remote_id.errors import (
    FieldError,
    FrameLengthError,
    FramingError,
    MessageTypeError,
    PackError,
    ProtocolVersionError,
    RemoteIdError,
)
from wonderland.remote_id.messages import (
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
from wonderland.remote_id.operators import public_operator_id

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
    "ProtocolVersion",
    "ProtocolVersionError",
    "RemoteIdError",
    "SelfId",
    "SpeedAccuracy",
    "System",
    "UaType",
    "VerticalAccuracy",
    "decode",
    "encode",
    "public_operator_id",
    "resolve_time",
]
