"""What goes wrong with a peer of ROS 2 or on the way to it; each text says what to do about it."""

from __future__ import annotations


class Ros2Error(Exception):
    """Base of all below."""


class WireError(Ros2Error):
    """A name, a token or an attachment that is none of rmw_zenoh's."""


class DefinitionError(Ros2Error):
    """A definition that cannot be used, a type that nobody here knows, or bytes that are no message of their type."""


class SessionError(Ros2Error):
    """The session cannot be opened as it is set up."""


class CallError(Ros2Error):
    """A service that did not answer, or not as it should."""
