"""Errors of the UCI codec and of the host-side state machine."""

from __future__ import annotations

from wonderland_fira_uci.errors import UwbError
from wonderland_fira_uci.uci.status import status_name


class UciError(UwbError):
    """Root of everything that the UCI parts raise."""


class UciEncodeError(UciError):
    """A message or configuration holds a value that the wire format cannot carry."""


class UciDecodeError(UciError):
    """Bytes from the other side that do not follow the format; the text says which field and why."""


class UciStatusError(UciError):
    """The node answered a command with a status other than OK.

    ``command`` is the command's name, ``status`` the octet (see ``uci.status.Status``).
    """

    def __init__(self, command: str, status: int, detail: str = "") -> None:
        super().__init__(f"{command} was answered by {status_name(status)}{': ' if detail else ''}{detail}")
        self.command = command
        self.status = status


class UciConfigRejectedError(UciStatusError):
    """SET_APP_CONFIG was refused; ``parameters`` maps each offending parameter id to its status octet.

    One bad parameter rejects the whole command, so the session is left unconfigured.
    """

    def __init__(self, status: int, parameters: dict[int, str], codes: dict[int, int]) -> None:
        named = ", ".join(f"{parameters[i]} (0x{i:02x}): {status_name(code)}" for i, code in codes.items())
        super().__init__("SESSION_SET_APP_CONFIG", status, named or "the node named no parameter")
        self.parameters = codes


class UciTimeoutError(UciError):
    """The node did not answer a command, or not send the notification that must follow, in time."""


class UciStateError(UciError):
    """A call that the present state of the node or session does not allow."""
