"""What the model has: scenarios (who is honest), their lemmas, and at which levels of assurance each is asked."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

DIRECTORY: Final = Path(__file__).parent / "model"
LEVELS: Final = (0, 1, 2, 3, 4)
REACHED: Final = "run_"
"""Lemmas of this name say that something can happen: else the others might hold of a model that does nothing."""
_LEMMA: Final = re.compile(r"\(\* lemma (\w+): (.*?) \*\)\n(query .*?\.)\n(?=\n)", re.DOTALL)
_SCENARIO: Final = re.compile(r"\A\(\* Scenario: (.*?) \*\)\n", re.DOTALL)
_EXCHANGE: Final = ("terms.pvl", "ground.pvl", "level_{level}.pvl", "exchange.pvl")
_SIGN_IN: Final = ("terms.pvl", "sign_in.pvl")
ORDER: Final = (
    "outsider",
    "later",
    "uav_key",
    "pad_key",
    "pad_and_uav_keys",
    "all_keys",
    "prekeys",
    "node",
    "node_sessions",
    "sign_in_tls",
    "sign_in_plain",
    "sign_in_mutual",
)


@dataclass(frozen=True, slots=True)
class Lemma:
    """One question. ``query`` is ProVerif's text of it."""

    name: str
    says: str
    query: str

    @property
    def reaches(self) -> bool:
        """Whether it asks that something can happen, and not that something cannot."""
        return self.name.startswith(REACHED)


@dataclass(frozen=True, slots=True)
class Scenario:
    """Who is honest, and what is asked then. ``levels``: none where levels of assurance have no part in it."""

    name: str
    says: str
    source: str
    lemmas: tuple[Lemma, ...]
    levels: tuple[int, ...]

    def libraries(self, level: int | None) -> tuple[str, ...]:
        """The files that ProVerif reads before the scenario."""
        return _SIGN_IN if level is None else tuple(name.format(level=level) for name in _EXCHANGE)

    def only(self, names: frozenset[str]) -> Scenario:
        """The scenario with these lemmas alone."""
        source = self.source
        for lemma in self.lemmas:
            if lemma.name not in names:
                source = source.replace(lemma.query, "")
        return replace(self, source=source, lemmas=tuple(each for each in self.lemmas if each.name in names))


def scenarios(directory: Path = DIRECTORY) -> tuple[Scenario, ...]:
    """All of them, in the order of the tables. Raises ValueError for a file that is none."""
    return tuple(_scenario(name, (directory / f"{name}.pv").read_text(encoding="utf-8")) for name in ORDER)


def _scenario(name: str, source: str) -> Scenario:
    header = _SCENARIO.match(source)
    found = _LEMMA.findall(source)
    if header is None or len(found) != len(re.findall(r"^query\b", source, re.MULTILINE)):
        raise ValueError(
            f"{name}.pv: it must begin with '(* Scenario: … *)', and each query with '(* lemma NAME: … *)'"
        )
    lemmas = tuple(Lemma(each, " ".join(says.split()), query) for each, says, query in found)
    levels = () if name.startswith("sign_in") else LEVELS
    return Scenario(name, " ".join(header[1].split()), source, lemmas, levels)
