"""docs/operate/data-protection.md: every table, column, record and field that there is has been classed, once."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil
import re
from pathlib import Path

import pytest
from sqlalchemy import Column, Integer, MetaData, Table

import wonderland.proofs.records
from wonderland.proofs.records.schema import Record
from wonderland_backend.db import tables
from wonderland_backend.settings import Settings

PAGE = Path(__file__).resolve().parents[2] / "docs" / "operate" / "data-protection.md"
NAMES = re.compile(r"`([A-Za-z0-9_]+)`")
PERSONAL = re.compile(r"none|\*\*([A-E])\*\*((?: `[a-z0-9_]+`)+)(?:; \*\*([A-E])\*\*((?: `[a-z0-9_]+`)+))*")
MUST = re.compile(
    r"(?:registration|operator_id|operator|uav_id|person|person_id|name_of|email|browser|note|reason|granted_by"
    r"|\w+_by|creator_name|owner|owner_id|\w*_reason|lat_e7|lon_e7)"
)
"""Whatever has such a name is personal, or is in `BUT` with its reason."""
BUT = {
    "bound_by": "which key bound the time stamps",
    "measured_by": "which radio",
    "anchored_by": "a server’s certificate",
    "ended_by": "pad, uav or authority",
    "Pad": "where a pad stands",
    "RegisterPad": "where a pad stands",
    "Frame": "where a pad stands",
    "Reason": "codes and numbers",
}


def section(text, title):
    """The rows of the table below a heading: name → cells."""
    body = re.search(rf"^## {title}\n(.*?)(?=^## |\Z)", text, re.DOTALL | re.MULTILINE)[1]
    found = {}
    for line in re.findall(r"^\| `.*\|$", body, re.MULTILINE):
        name, *cells = (cell.strip() for cell in line.strip("|").split(" | "))
        name = NAMES.fullmatch(name)[1]
        assert name not in found, f"{name} stands twice"
        found[name] = cells
    return found


def unlike(rows, known):
    """What is wrong with the rows, given what there is: name → columns or fields."""
    wrong = [f"{name}: not classed" for name in known if name not in rows]
    wrong += [f"{name}: is not there" for name in rows if name not in known]
    for name in rows.keys() & known.keys():
        personal, other, *_ = rows[name]
        if not PERSONAL.fullmatch(personal):
            wrong.append(f"{name}: {personal!r} names no classes")
        classed, rest = NAMES.findall(personal), NAMES.findall(other)
        wrong += [f"{name}.{each}: not classed" for each in known[name] if each not in {*classed, *rest}]
        wrong += [f"{name}.{each}: is not there" for each in {*classed, *rest} - {*known[name]}]
        wrong += [f"{name}.{each}: personal and not" for each in {*classed} & {*rest}]
        wrong += [
            f"{name}.{each}: cannot be without a class"
            for each in rest
            if MUST.fullmatch(each) and each not in BUT and not (name in BUT and each in {"lat_e7", "lon_e7"})
        ]
    return wrong


def of_tables(metadata):
    return {each.name: [column.name for column in each.columns] for each in metadata.sorted_tables}


def records():
    package = wonderland.proofs.records
    for each in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"{package.__name__}.{each.name}")
    waiting, found = [Record], {}
    while waiting:
        for each in waiting.pop().__subclasses__():
            waiting.append(each)
            # `slots=True` makes a class anew, and its first form may still be about; records of tests are no records.
            if each.__module__.startswith(package.__name__):
                found[each.__name__] = [field.name for field in dataclasses.fields(each)]
    return found


def test_every_column_of_every_table_is_classed():
    known = of_tables(tables.Base.metadata)
    assert len(known) > 40
    assert unlike(section(PAGE.read_text(), "Tables of the backend"), known) == []


def test_every_field_of_every_record_is_classed():
    known = records()
    assert {"Uav", "Session", "Verdict", "RegisterUav"} <= known.keys()
    assert unlike(section(PAGE.read_text(), "Records of the ledger"), known) == []


def test_every_table_says_how_long_it_is_kept():
    ledger = {each.__tablename__ for each in tables.ledger.ledger_tables()}
    for name, (_, _, kept) in section(PAGE.read_text(), "Tables of the backend").items():
        assert kept, name
        assert (kept == "as the ledger") is (name in ledger), name


def test_the_times_are_those_of_the_settings():
    told = re.findall(r"^\| [^|]+ \| `(\w+)` \| (\d+) h \|$", PAGE.read_text(), re.MULTILINE)
    fields = Settings.model_fields
    assert {name: float(hours) for name, hours in told} == {
        name: fields[name].default for name in fields if name.endswith("_retention_h")
    }
    named = {each for _, _, kept in section(PAGE.read_text(), "Tables of the backend").values()
             for each in NAMES.findall(kept)}  # fmt: skip
    assert named == dict(told).keys()


def test_a_class_that_is_used_is_explained():
    text = PAGE.read_text()
    explained = re.findall(r"^\| \*\*([A-Z])\*\* [A-Z]\w+ \| [^|]+ \| [^|]+ \| [^|]+ \| [^|]+ \|$", text, re.MULTILINE)
    assert explained == ["A", "B", "C", "D", "E"]


@pytest.mark.parametrize(
    ("row", "problem"),
    [
        ("", "pilots: not classed"),
        ("| `pilots` | none | `id` |", "pilots.email: not classed"),
        ("| `pilots` | none | `id` `email` |", "pilots.email: cannot be without a class"),
        ("| `pilots` | `email` | `id` |", "pilots: '`email`' names no classes"),
        ("| `pilots` | **C** `email` `age` | `id` |", "pilots.age: is not there"),
        ("| `pilots` | **C** `email` | `id` `email` |", "pilots.email: personal and not"),
        ("| `pilots` | **C** `email` | `id` |\n| `ghosts` | none | `id` |", "ghosts: is not there"),
    ],
)
def test_what_nobody_has_classed_would_be_seen(row, problem):
    metadata = MetaData()
    Table("pilots", metadata, Column("id", Integer), Column("email", Integer))
    assert problem in unlike(
        section(f"## Tables of the backend\n\n{row}\n", "Tables of the backend"), of_tables(metadata)
    )
    right = "## Tables of the backend\n| `pilots` | **C** `email`; **E** `email` | `id` |\n"
    assert unlike(section(right, "Tables of the backend"), of_tables(metadata)) == []
