"""docs/operate/asvs.md: whole, in order, and no row names a test that is not there."""

from __future__ import annotations

import ast
import functools
import re
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "operate" / "asvs.md"
ROW = re.compile(r"^\| v5\.0\.0-(\d+\.\d+\.\d+) \| ([^|]+) \| ([^|]+) \|$")
REFERENCE = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")
LEVELS = {
    "1.1": "22", "1.2": "1111122223", "1.3": "112222222223", "1.4": "222", "1.5": "123",
    "2.1": "122", "2.2": "112", "2.3": "12223", "2.4": "23",
    "3.1": "3", "3.2": "113", "3.3": "12223", "3.4": "11222233", "3.5": "11122333", "3.6": "3", "3.7": "22333",
    "4.1": "12233", "4.2": "23333", "4.3": "22", "4.4": "1222",
    "5.1": "2", "5.2": "112333", "5.3": "113", "5.4": "222",
    "6.1": "122", "6.2": "111111112222", "6.3": "11223333", "6.4": "112233", "6.5": "22222333", "6.6": "2223",
    "6.7": "33", "6.8": "2222",
    "7.1": "222", "7.2": "1111", "7.3": "22", "7.4": "11222", "7.5": "223", "7.6": "22",
    "8.1": "1233", "8.2": "1123", "8.3": "133", "8.4": "23", "9.1": "111", "9.2": "1222",
    "10.1": "22", "10.2": "223", "10.3": "22223", "10.4": "1111122222233333", "10.5": "22222", "10.6": "22",
    "10.7": "222",
    "11.1": "2233", "11.2": "22233", "11.3": "11233", "11.4": "1222", "11.5": "23", "11.6": "23", "11.7": "33",
    "12.1": "12233", "12.2": "11", "12.3": "22223",
    "13.1": "2333", "13.2": "222223", "13.3": "2233", "13.4": "1222233",
    "14.1": "22", "14.2": "12223333", "14.3": "122",
    "15.1": "12233", "15.2": "12233", "15.3": "1222222", "15.4": "3333",
    "16.1": "2", "16.2": "22222", "16.3": "2222", "16.4": "222", "16.5": "2223",
    "17.1": "23", "17.2": "22223333", "17.3": "22",
}  # fmt: skip
"""Of each section of ASVS 5.0.0, the level of each requirement in order."""
NUMBERS = [
    (*map(int, section.split(".")), index)
    for section, levels in LEVELS.items()
    for index, level in enumerate(levels, 1)
    if level in "12"
]


def rows(text):
    """(number, how it holds) of each row."""
    found = (ROW.match(line) for line in text.splitlines() if line.startswith("| v5"))
    return [(tuple(map(int, each[1].split("."))), each[3]) for each in found if each is not None]


def kind(held):
    """Under which count a row falls."""
    for beginning, name in (
        ("Does not apply: ", "Does not apply"),
        ("**Not met:** ", "Not met"),
        ("By design: ", "By design"),
    ):
        if held.startswith(beginning) and len(held) > len(beginning) + 3:
            return name
    assert REFERENCE.match(held), f"neither a test nor a reason: {held}"
    return "By a test"


@functools.cache
def named_in(path):
    tree = ast.parse((ROOT / path).read_text()) if (ROOT / path).is_file() else ast.Module([], [])
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    return {each.name for each in ast.walk(tree) if isinstance(each, functions) and each.name.startswith("test_")}


def missing(text):
    """Tests that a text names and that are not there."""
    return [f"{path}::{name}" for path, name in REFERENCE.findall(text) if name not in named_in(path)]


def test_every_requirement_of_levels_1_and_2_has_its_row_in_order():
    text = PAGE.read_text()
    assert len(NUMBERS) == 253
    assert [number for number, _ in rows(text)] == NUMBERS
    assert len(rows(text)) == sum(line.startswith("| v5") for line in text.splitlines()), "a row that is not one"


def test_every_test_that_is_named_is_there():
    text = PAGE.read_text()
    assert missing(text) == []
    # Each mention in backquotes is one that is looked for: no brackets, no spaces, no other spelling.
    assert text.count("::") == len(REFERENCE.findall(text))


def test_the_counts_are_those_of_the_rows():
    text = PAGE.read_text()
    told = {
        name: int(count)
        for name, count in re.findall(r"^\| ([A-Z][a-z ]+?)(?:, [^|]*)? \| (\d+) \|$", text, re.MULTILINE)
    }
    assert told == Counter(kind(held) for _, held in rows(text))


def test_what_is_not_met_is_in_the_list_by_weight():
    text = PAGE.read_text()
    listed = re.search(r"## What is not met.*?\n\n(.*?)\n\n## ", text, re.DOTALL)[1]
    named = [tuple(map(int, each.split("."))) for each in re.findall(r"\b\d+\.\d+\.\d+\b", listed)]
    assert len(named) == len(set(named))
    assert set(named) == {number for number, held in rows(text) if kind(held) == "Not met"}


@pytest.mark.parametrize(
    "held", ["Does not apply: ", "**Not met:** ", "Yes", "`tests/house/test_asvs.py`", "see `tests/a.py::test_b`"]
)
def test_a_row_without_test_and_reason_is_none(held):
    with pytest.raises(AssertionError, match="neither"):
        kind(held)


def test_a_test_that_is_not_there_would_be_seen():
    here = "tests/house/test_asvs.py"
    assert missing(f"`{here}::test_every_test_that_is_named_is_there`") == []
    assert missing(f"`{here}::test_nothing` `tests/none.py::test_a`") == [
        f"{here}::test_nothing",
        "tests/none.py::test_a",
    ]
