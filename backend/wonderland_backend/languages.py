"""In which language a text is answered: English, or Finnish where the request prefers it (RFC 9110, 12.5.4)."""

from __future__ import annotations

from typing import Annotated, Any, Final

from fastapi import Depends
from starlette.requests import HTTPConnection

from wonderland.messages import LANGUAGES, Language

HEADER: Final[dict[str, Any]] = {
    "name": "Accept-Language",
    "in": "header",
    "required": False,
    "description": "Language of texts: `en` or `fi`",
    "schema": {"type": "string"},
    "example": "fi",
}
MAX_HEADER: Final = 200


def language_of(request: HTTPConnection) -> Language:
    """The language that the request prefers among those there are."""
    best: tuple[float, Language] = (0.0, "en")
    for part in request.headers.get("accept-language", "")[:MAX_HEADER].split(","):
        name, _, parameter = part.strip().partition(";")
        language = next((each for each in LANGUAGES if each == name.partition("-")[0].lower()), None)
        quality = _quality(parameter)
        if language is not None and quality > best[0]:
            best = (quality, language)
    return best[1]


LanguageDep = Annotated[Language, Depends(language_of)]


def _quality(parameter: str) -> float:
    """The q of a header's part; 1 where there is none, 0 where it is no number."""
    name, _, value = parameter.strip().partition("=")
    if name.strip() != "q":
        return 1.0
    try:
        found = float(value)
    except ValueError:
        return 0.0
    return found if 0 <= found <= 1 else 0.0
