"""The operator's registration number (EN 4709-002): which part of it may be seen."""

from __future__ import annotations

import re
from typing import Final

_EU: Final = re.compile(r"([A-Za-z]{3}[A-Za-z0-9]{13})(?:-?[A-Za-z0-9]{0,3})?\Z")
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
