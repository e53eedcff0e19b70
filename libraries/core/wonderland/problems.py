"""What goes wrong, as a key of the catalogue `problems` and facts, until somebody asks in a language."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from wonderland import messages
from wonderland.messages import Language


@dataclass(frozen=True, slots=True)
class Said:
    """A sentence of the catalogue with its facts; as a text, for logs and commands, it is English."""

    key: str
    facts: Mapping[str, int | str | Said]

    def text(self, language: Language = "en") -> str:
        """In a language; so is what stands in it."""
        facts = {name: each.text(language) if isinstance(each, Said) else each for name, each in self.facts.items()}
        return messages.text("problems", self.key, facts, language)

    __str__ = text


class SaidError(Exception):
    """What went wrong can be said in every language."""

    def __init__(self, said: Said) -> None:
        super().__init__(said)
        self.said = said


def said(key: str, **facts: int | str | Said | Exception) -> Said:
    """The sentence `key` of `libraries/core/wonderland/messages/<language>/problems.json`.

    An error as a fact is what it says itself: `SaidError` in every language, any other in its own words.
    """
    if key not in messages.keys_of("problems"):
        raise KeyError(key)
    return Said(key, {name: _fact(value) for name, value in facts.items()})


def in_language(text: Said | str, language: Language) -> str:
    """A sentence of the catalogue in a language; others' words as they are."""
    return text.text(language) if isinstance(text, Said) else text


def _fact(value: int | str | Said | Exception) -> int | str | Said:
    if isinstance(value, SaidError):
        return value.said
    return str(value) if isinstance(value, Exception) else value
