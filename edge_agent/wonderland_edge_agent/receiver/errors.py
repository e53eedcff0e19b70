"""What the receiver raises."""

from __future__ import annotations


class ReceiverError(Exception):
    """The receiver cannot listen where it was told to; the text names the address, device or setting."""
