"""What reading a message raises."""

from __future__ import annotations


class TelemetryError(Exception):
    """A frame or record that is not as it must be: `code` for machines, `message` (at most 300 characters) for people.

    Codes: ``bad_hello``, ``bad_frame``, ``unknown_type``, ``bad_record``, ``unknown_kind``, ``bad_body``; the backend
    adds its own.
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
