"""The secure link over in-band data: ``Link``, its keys, events, message types and errors."""

from wonderland.uwb.link.cipher import LinkKeys, Role
from wonderland.uwb.link.errors import (
    FrameError,
    LinkBusyError,
    LinkClosedError,
    LinkError,
    LinkKeysError,
    MessageTooLargeError,
    PayloadError,
)
from wonderland.uwb.link.link import (
    AbortCause,
    Link,
    LinkAborted,
    LinkEvent,
    LinkStatistics,
    MessageDelivered,
    MessageReceived,
)
from wonderland.uwb.link.messages import Abort, AbortReason, Echo, Identity, MessageType
from wonderland.uwb.link.segments import MAX_FRAME_OCTETS, MAX_MESSAGE_OCTETS, PAD_ADDRESS, UAV_ADDRESS

__all__ = [
    "MAX_FRAME_OCTETS",
    "MAX_MESSAGE_OCTETS",
    "PAD_ADDRESS",
    "UAV_ADDRESS",
    "Abort",
    "AbortCause",
    "AbortReason",
    "Echo",
    "FrameError",
    "Identity",
    "Link",
    "LinkAborted",
    "LinkBusyError",
    "LinkClosedError",
    "LinkError",
    "LinkEvent",
    "LinkKeys",
    "LinkKeysError",
    "LinkStatistics",
    "MessageDelivered",
    "MessageReceived",
    "MessageTooLargeError",
    "MessageType",
    "PayloadError",
    "Role",
]
