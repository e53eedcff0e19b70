"""The root of every error that ``wonderland.uwb`` raises."""

from __future__ import annotations


class UwbError(Exception):
    """Anything that went wrong with a radio, its port, its protocol or the link over it."""


class RangingPlanError(UwbError):
    """A ranging plan that no set of nodes could run; the text names the field."""


class NodeError(UwbError):
    """A node, or a session on it, cannot do what was asked."""


class NodeUnavailableError(NodeError):
    """The node did not answer in time, or its port is gone; it is being retried in the background."""


class NodeClosedError(NodeError):
    """The node or the session was closed by this program."""
