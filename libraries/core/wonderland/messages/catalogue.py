"""The messages of a language, and how facts are shown in it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from functools import cache
from importlib.resources import files
from typing import Final, Literal, get_args

from icu4py.messageformat import MessageFormat

Language = Literal["en", "fi"]
LANGUAGES: Final[tuple[Language, ...]] = get_args(Language)
_LOCALES: Final[Mapping[Language, str]] = {"en": "en-GB", "fi": "fi"}
FAR_MM: Final = 100_000
"""From here on lengths are shown without decimals."""
UNKNOWN: Final = "?"
"""Stands where a message names a fact that there is none of; 0 where it counts."""
TIMES: Final = frozenset({"since_ms", "until_ms"})
"""Facts that are moments (Unix time); all others that end in ``_ms`` are durations."""
# Units stand behind a no-break space, so that no line ends between the two.
_PATTERNS: Final[Mapping[str, str]] = {
    "_mm": "{value, number, ::scale/0.001 .00}\u00a0m",
    "far": "{value, number, ::scale/0.001 precision-integer}\u00a0m",
    "_ms": "{value, number, ::scale/0.001 .0}\u00a0s",
    "_percent": "{value, number}\u00a0%",
    "_milli": "{value, number, ::scale/0.001 .0}",
}

# Not by ICU, which would write them in this machine's zone.
_MOMENTS: Final[Mapping[Language, str]] = {
    "en": "{0:%Y-%m-%d} {0:%H:%M}\u00a0UTC",
    "fi": "{0.day}.{0.month}.{0.year} klo\u00a0{0:%H.%M}\u00a0UTC",
}


@cache
def _catalogue(domain: str, language: Language) -> Mapping[str, str]:
    data = files("wonderland.messages").joinpath(language, f"{domain}.json").read_bytes()
    messages: dict[str, str] = json.loads(data)
    return messages


def keys_of(domain: str, language: Language = "en") -> frozenset[str]:
    """What a file of messages has texts for."""
    return frozenset(_catalogue(domain, language))


def message_of(domain: str, key: str, language: Language = "en") -> str | None:
    """The ICU message itself; None where there is none."""
    return _catalogue(domain, language).get(key)


def facts_of(domain: str, key: str, language: Language = "en") -> frozenset[str]:
    """The facts that a message names."""
    return frozenset(_without(domain, key, language))


@cache
def _parsed(domain: str, key: str, language: Language) -> MessageFormat | None:
    message = message_of(domain, key, language)
    return None if message is None else MessageFormat(message, _LOCALES[language])


@cache
def _without(domain: str, key: str, language: Language) -> Mapping[str, int | str]:
    """What stands for each fact of a message where there is none."""
    arguments = _arguments(message_of(domain, key, language) or "")
    return {name: 0 if kind in {"number", "plural"} else UNKNOWN for name, kind in arguments}


def _arguments(message: str) -> Iterator[tuple[str, str]]:
    """Name and type of each argument of an ICU message, those within choices too."""
    for inner in _in_braces(message):
        name, kind, choices = f"{inner},,".split(",", 2)
        yield name.strip(), kind.strip()
        if kind.strip() in {"plural", "select"}:
            for choice in _in_braces(choices):
                yield from _arguments(choice)


def _in_braces(text: str) -> Iterator[str]:
    """What stands in each pair of outer braces; no message quotes any (a test holds it)."""
    depth = start = 0
    for at, each in enumerate(text):
        if each == "{":
            depth += 1
            start = at + 1 if depth == 1 else start
        elif each == "}":
            depth -= 1
            if depth == 0:
                yield text[start:at]


@cache
def _shape(name: str, language: Language) -> MessageFormat:
    return MessageFormat(_PATTERNS[name], _LOCALES[language])


def fact_text(name: str, value: int | str, language: Language) -> int | str:
    """A fact as a message has it: with its unit, or the number itself."""
    if isinstance(value, str):
        return value
    if name in TIMES:
        return _MOMENTS[language].format(datetime.fromtimestamp(value / 1000, UTC))
    unit = next((each for each in ("_mm", "_ms", "_percent", "_milli") if name.endswith(each)), None)
    if unit is None:
        return value
    if unit == "_mm" and abs(value) >= FAR_MM:
        unit = "far"
    return _shape(unit, language).format({"value": value})


def text(domain: str, key: str, facts: Mapping[str, int | str], language: Language = "en") -> str:
    """A message with its facts; where the catalogue has none (a newer contract's code), the code and the facts."""
    parsed = _parsed(domain, key, language)
    if parsed is None:
        return f"{key} ({', '.join(f'{name} {value}' for name, value in facts.items())})" if facts else key
    known = {name: fact_text(name, value, language) for name, value in facts.items()}
    return parsed.format({**_without(domain, key, language), **known})
