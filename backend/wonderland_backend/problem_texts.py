"""What problems say, by name: English as they are raised, any other language when they are answered."""

from __future__ import annotations

from typing import Self

from wonderland import messages
from wonderland_backend.languages import Language


class Said(str):
    """A sentence of the catalogue `problems`: English as a text, and the same in each language."""

    __slots__ = ("facts", "key")
    key: str
    facts: dict[str, int | str]

    def __new__(cls, key: str, **facts: int | str) -> Self:
        """Raises KeyError where the catalogue has no such sentence."""
        if key not in messages.keys_of("problems"):
            raise KeyError(key)
        made = super().__new__(cls, messages.text("problems", key, facts))
        made.key, made.facts = key, facts
        return made

    def __getnewargs_ex__(self) -> tuple[tuple[str], dict[str, int | str]]:
        return (self.key,), self.facts


def said(key: str, **facts: int | str) -> Said:
    """The sentence `key` of `libraries/core/wonderland/messages/<language>/problems.json`."""
    return Said(key, **facts)


def in_language(text: str, language: Language) -> str:
    """A sentence of the catalogue in a language; any other text is as it is."""
    return messages.text("problems", text.key, text.facts, language) if isinstance(text, Said) else text


def title_in(code: str, language: Language) -> str | None:
    """The title of a kind of problem; None in English, where it is that of the status."""
    return None if language == "en" else messages.message_of("problem-titles", code, language)
