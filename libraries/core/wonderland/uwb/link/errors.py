"""Errors of the secure link."""

from __future__ import annotations

from wonderland_fira_uci.errors import UwbError


class LinkError(UwbError):
    """Root of everything that the secure link raises."""


class LinkKeysError(LinkError):
    """Keys of a wrong size, or the same key for both directions."""


class LinkClosedError(LinkError):
    """The link was aborted; it takes no more messages. Start a new session with new keys."""


class MessageTooLargeError(LinkError):
    """A message above the size limit."""


class LinkBusyError(LinkError):
    """More is waiting to be delivered than the link will hold; send again after the next MessageDelivered."""


class FrameError(LinkError):
    """Bytes that are no frame of this link: truncated, of another version, or with impossible lengths."""


class PayloadError(LinkError):
    """The payload of a message does not have the form of its type; the text says which field and why."""
