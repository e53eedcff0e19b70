"""What goes wrong in a bridge, each with what to do about it."""

from __future__ import annotations


class BridgeError(Exception):
    """The bridge cannot start, or cannot go on."""


class SpoolError(BridgeError):
    """The spool's file cannot be used: it is damaged, belongs to another bridge, or its disk is full."""


class WireError(BridgeError):
    """A peer or a master of ROS that does not keep to the protocol, or to this bridge's limits."""


class DefinitionError(BridgeError):
    """A message definition that cannot be used, or a message that does not fit its definition."""


class EnvelopeError(BridgeError):
    """An asset's value that is none of a bridge's, though its media type says so."""
