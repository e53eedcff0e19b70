"""What the Remote ID codec raises: one tree, so that a receiver catches one type."""

from __future__ import annotations


class RemoteIdError(Exception):
    """Base of everything that this package raises on purpose.

    ``offset`` is the byte of the frame at which the fault lies; None where a message was to be encoded.
    """

    def __init__(self, message: str, offset: int | None = None) -> None:
        super().__init__(message if offset is None else f"byte {offset}: {message}")
        self.message = message
        self.offset = offset


class FrameLengthError(RemoteIdError):
    """A frame that is neither one message of 25 bytes nor a pack of the length that it announces."""


class ProtocolVersionError(RemoteIdError):
    """A protocol version that nobody has published yet."""


class MessageTypeError(RemoteIdError):
    """A message type that the standard does not define, or a pack inside a pack."""


class FieldError(RemoteIdError):
    """A field with a reserved or impossible value; ``field`` is its name in the message."""

    def __init__(self, field: str, message: str, offset: int | None = None) -> None:
        super().__init__(f"{field}: {message}", offset)
        self.field = field


class PackError(RemoteIdError):
    """A pack with a bad message inside, or with messages that may not stand together.

    ``index`` is the place of the bad message in the pack (from 0; −1 for the pack itself) and ``cause`` its error.
    """

    def __init__(
        self, message: str, offset: int | None = None, *, index: int = -1, cause: RemoteIdError | None = None
    ) -> None:
        super().__init__(message, offset)
        self.index = index
        self.cause = cause


class FramingError(RemoteIdError):
    """A line or another wrapping in which no frame can be found."""
