"""The contract's reasons with words beside their codes and facts."""

from __future__ import annotations

from typing import Any

from wonderland import messages
from wonderland.messages import Language


def reasons_in(language: Language, reasons: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The reasons of a record, each with its text in a language."""
    return [
        reason | {"text": messages.text("reasons", reason["code"], reason["facts"], language)} for reason in reasons
    ]
