"""The operator's registration number (EN 4709-002): its form, and which part of it may be seen."""

from __future__ import annotations

import re
from typing import Final

from wonderland_remote_id.errors import FieldError

_EU: Final = re.compile(r"([A-Za-z]{3}[A-Za-z0-9]{13})(?:-?[A-Za-z0-9]{0,3})?\Z")
_ALPHABET: Final = "0123456789abcdefghijklmnopqrstuvwxyz"
_FULL: Final = re.compile(r"([A-Z]{3})([0-9a-z]{12})([0-9a-z])-([0-9a-z]{3})\Z")
_PUBLIC: Final = re.compile(r"[A-Z]{3}[0-9a-z]{13}\Z")
_SECRET: Final = re.compile(r"-[^-]{0,3}\Z")


def public_operator_id(text: str) -> str:
    """An operator's registration without its secret.

    A European number is country (3), 12 characters and a check character, and then, where the operator typed them
    in too, a dash and three secret characters. Any other text loses what may be such an ending: rather a
    registration cut short than a secret kept.
    """
    european = _EU.match(text)
    if european:
        return european.group(1)
    return _SECRET.sub("", text)


def is_european_operator_id(text: str) -> bool:
    """Whether a text has the form of the public part: country (three capitals), 12 characters, check character."""
    return _PUBLIC.match(text) is not None


def check_operator_id(text: str) -> str:
    """The public part of a complete registration ``FIN87astrdge12k8-xyz`` whose check character is right.

    The check character (Luhn over the base of 36, EN 4709-002) covers the three secret characters, too, so that it can
    be verified only where the operator enters the number, never from a broadcast. Raises `FieldError`.
    """
    match = _FULL.match(text)
    if match is None:
        raise FieldError("operator id", "is country (3 capitals), 12 characters, check character, dash, 3 characters")
    country, number, check, secret = match.groups()
    if check != check_character(number + secret):
        raise FieldError("operator id", "its check character does not fit; was it copied completely?")
    return f"{country}{number}{check}"


def check_character(text: str) -> str:
    """Luhn's check character over digits and letters (base 36), as EN 4709-002 asks. Raises `FieldError`."""
    total = 0
    for place, character in enumerate(reversed(text)):
        code = _ALPHABET.find(character)
        if code < 0:
            raise FieldError("operator id", "holds a character that is neither a small letter nor a digit")
        if place % 2 == 0:
            code *= 2
        total += code // 36 + code % 36
    return _ALPHABET[-total % 36]
