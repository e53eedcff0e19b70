"""How the contract refuses: a status, a code for machines, a sentence for people."""

from __future__ import annotations

from typing import Final

MAX_TEXT: Final = 800
BAD_INPUT: Final = 400
NOT_ALLOWED: Final = 403
NOT_THERE: Final = 404
CONFLICT: Final = 409
REFUSED: Final = 422
BROKEN: Final = 500


class ContractError(Exception):
    """A transaction that the contract refuses; its text is ``CODE: what was wrong; what to do``.

    ``status``: 400 bad input, 403 not allowed, 404 not there, 409 in conflict with what is there, 422 refused by
    state or time, 500 state on the ledger that this version cannot read. A ledger reports it to the client as
    ``chaincode response <status>, <text>``.
    """

    def __init__(self, status: int, code: str, text: str) -> None:
        # What a client sent may be quoted in it: no line of a log may be forged, and no log flooded.
        clean = "".join(character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in text)
        if len(clean) > MAX_TEXT:
            clean = clean[: MAX_TEXT - 1] + "…"
        super().__init__(f"{code}: {clean}")
        self.status = status
        self.code = code


def bad_input(code: str, text: str) -> ContractError:
    """400: the argument is wrong, whatever the state."""
    return ContractError(BAD_INPUT, code, text)


def not_allowed(code: str, text: str) -> ContractError:
    """403: this creator may not do this."""
    return ContractError(NOT_ALLOWED, code, text)


def not_there(code: str, text: str) -> ContractError:
    """404: what the argument names does not exist."""
    return ContractError(NOT_THERE, code, text)


def conflict(code: str, text: str) -> ContractError:
    """409: something with that name, or another version of it, is there."""
    return ContractError(CONFLICT, code, text)


def refused(code: str, text: str) -> ContractError:
    """422: well-formed and allowed, but not in this state or at this time."""
    return ContractError(REFUSED, code, text)
