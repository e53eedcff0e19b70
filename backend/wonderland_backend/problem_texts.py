"""What problems are called; what they say is `wonderland.problems`."""

from __future__ import annotations

from typing import Final

from wonderland import messages
from wonderland.messages import Language

TYPE_BASE: Final = "urn:wonderland:problem:"
"""What a problem's type begins with; its code follows."""
STANDBY: Final = "standby"
"""The code of a server that waits for another's end: of its answers, and why it closes a socket."""


def title_in(code: str, language: Language) -> str | None:
    """The title of a kind of problem; None in English, where it is that of the status."""
    return None if language == "en" else messages.message_of("problem-titles", code, language)
