"""Lists of drones, authorisations, maintenance or pads as CSV or JSON: in whatever way an office writes them.

They are checked line by line, and nothing is changed: what is right comes back as arguments to sign one by one, what is
wrong by line and column. The same columns write a list of what the ledger has.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final

from wonderland.messages import Language
from wonderland.problems import Said, SaidError, in_language, said
from wonderland.proofs.errors import RecordError
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.schema import Record
from wonderland.proofs.records.uavs import normalised_registration, without_secret
from wonderland_remote_id.errors import FieldError
from wonderland_remote_id.operators import check_operator_id

REGISTRATION: Final = "registration"
"""The column whose value is not part of the argument: the argument commits to it."""
MAX_BYTES: Final = 1 << 20
MAX_ROWS: Final = 5_000
MAX_ERRORS: Final = 1_000
_NUMBER: Final = re.compile(r"[A-Za-z0-9-]{1,32}")
_DELIMITERS: Final = (",", ";", "\t")
_BOMS: Final = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))


class ListError(SaidError, ValueError):
    """What is no list of this kind at all."""


class CellError(SaidError, ValueError):
    """What stands in a cell is no value of its column."""


def _text(value: str) -> str:
    return value


def _scaled(scale: float, unit: str) -> Callable[[str], int]:
    def read(value: str) -> int:
        try:
            number = float(value.replace(",", "."))
        except ValueError:
            raise CellError(said("csv_no_number", value=value[:40], unit=unit)) from None
        if not math.isfinite(number) or abs(number) > 1e6:
            raise CellError(said("csv_no_number", value=value[:40], unit=unit))
        return round(number * scale)

    return read


def _time(value: str) -> int:
    """A date (from its first moment, UTC), a moment in ISO 8601 (UTC unless it says otherwise), or milliseconds."""
    if value.isascii() and value.isdigit() and len(value) > 8:
        return int(value[:16])
    try:
        moment = datetime.fromisoformat(value)
    except ValueError:
        raise CellError(said("csv_no_date", value=value[:40])) from None
    return int((moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)).timestamp() * 1000)


def _registration(value: str) -> str:
    """The public part: the secret is used to check the number and then left out."""
    if without_secret(value) == value:
        return value
    try:
        return check_operator_id(value[:3].upper() + value[3:].lower())
    except FieldError:
        raise CellError(said("csv_check_character")) from None


def _number(value: str) -> str:
    """As it is committed to."""
    return normalised_registration(_registration(value))


def _actions(value: str) -> list[str]:
    return value.replace("|", " ").replace("/", " ").replace("+", " ").split()


def _unscaled(scale: float) -> Callable[[Any], str]:
    return lambda value: f"{value / scale:.7f}".rstrip("0").rstrip(".")


WHEN: Final = "A date (its first moment) or a moment, ISO 8601, UTC unless it says otherwise"


def _moment(value: Any) -> str:
    """In UTC, so that it reads back as the same millisecond."""
    moment = datetime.fromtimestamp(value // 1000, UTC).replace(microsecond=value % 1000 * 1000)
    return moment.isoformat(timespec="milliseconds" if value % 1000 else "seconds").replace("+00:00", "Z")


@dataclass(frozen=True)
class Column:
    """A column of the file: the field that it fills, and how a cell is read and written."""

    field: str
    read: Callable[[str], Any] = _text
    write: Callable[[Any], str] = str
    optional: bool = False
    says: str = ""
    """What a cell holds, where that is not what the field holds."""


@dataclass(frozen=True)
class Kind:
    """A kind of list: the transaction that each line becomes, and its columns by their names in the first line."""

    function: str
    columns: Mapping[str, Column]
    key: tuple[str, ...]

    @property
    def argument(self) -> type[Record]:
        """The record of each line."""
        return tx.TRANSACTIONS[self.function].argument


KINDS: Final = {
    "drones": Kind(
        "RegisterUav",
        {
            **{name: Column(name) for name in ("uav_id", "model", "operator_id")},
            REGISTRATION: Column(
                REGISTRATION, _number, optional=True, says="Operator registration number; see --openings"
            ),
        },
        ("uav_id",),
    ),
    "authorisations": Kind(
        "GrantAuthorisation",
        {
            **{name: Column(name) for name in ("uav_id", "authorisation_id", "pad_id")},
            "actions": Column("actions", _actions, " ".join, says="Of land, takeoff, dock; several with + between"),
            "valid_from": Column("valid_from_ms", _time, _moment, says=WHEN),
            "valid_until": Column("valid_until_ms", _time, _moment, says=WHEN),
        },
        ("uav_id", "authorisation_id"),
    ),
    "maintenance": Kind(
        "RecordMaintenance",
        {
            "uav_id": Column("uav_id"),
            "performed": Column("performed_ms", _time, _moment, says=WHEN),
            "valid_until": Column("valid_until_ms", _time, _moment, says=WHEN),
            "work": Column("work"),
        },
        ("uav_id",),
    ),
    "pads": Kind(
        "RegisterPad",
        {
            **{name: Column(name) for name in ("pad_id", "name", "operator_id")},
            "latitude": Column("lat_e7", _scaled(1e7, "degrees"), _unscaled(1e7), says="WGS-84 latitude, in degrees"),
            "longitude": Column("lon_e7", _scaled(1e7, "degrees"), _unscaled(1e7), says="WGS-84 longitude, in degrees"),
            "height_m": Column(
                "height_mm", _scaled(1e3, "metres"), _unscaled(1e3), says="Height above the WGS-84 ellipsoid, in metres"
            ),
            "note": Column("note", optional=True),
        },
        ("pad_id",),
    ),
}


@dataclass(frozen=True)
class CellProblem:
    """What is wrong in a cell, or ("") in a whole line."""

    line: int
    column: str
    message: Said | str

    def problem_json(self, language: Language) -> dict[str, Any]:
        """As ImportError of the API."""
        return {"line": self.line, "column": self.column, "message": in_language(self.message, language)[:300]}


@dataclass
class Checked:
    """What was found in a file. Lines are counted as an editor shows them, from 1."""

    encoding: str
    delimiter: str
    rows: list[dict[str, Any]] = field(default_factory=list)
    errors: list[CellProblem] = field(default_factory=list)

    def wrong(self, line: int, column: str, message: Said | str) -> None:
        """Note an error at a line (from 1) and column; more than `MAX_ERRORS` are counted, not shown."""
        self.errors.append(CellProblem(line, column, message))

    def shown_errors(self, language: Language) -> list[dict[str, Any]]:
        """The first of them, as ImportCheck has them."""
        return [each.problem_json(language) for each in self.errors[:MAX_ERRORS]]


def check(kind: Kind, data: bytes) -> Checked:
    """Read a file. Raises `ListError` for one that is no list of this kind at all."""
    text, encoding = _decoded(data)
    lines = text.splitlines()
    if not lines or not lines[0].strip():
        raise ListError(said("csv_no_header"))
    delimiter = max(_DELIMITERS, key=lines[0].count)
    found = Checked(encoding, delimiter)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    try:
        header = [name.strip().lower() for name in next(reader)]
        _require_columns(kind, header)
        seen: dict[tuple[str, ...], int] = {}
        for cells in reader:
            if any(cell.strip() for cell in cells):
                if len(seen) >= MAX_ROWS:
                    raise ListError(said("csv_too_long", most=MAX_ROWS))
                _row(kind, header, [cell.strip() for cell in cells], reader.line_num, seen, found)
    except csv.Error as error:
        found.wrong(reader.line_num, "", said("csv_not_read_on", why=error))
    return found


def check_json(kind: Kind, data: bytes) -> Checked:
    """As `check`, for a list of objects with the same names; lines are counted as entries. Raises `ListError`."""
    try:
        entries = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise ListError(said("list_no_json", why=str(error)[:200])) from None
    if not isinstance(entries, list) or not entries or not all(isinstance(each, dict) for each in entries):
        raise ListError(said("list_no_json", why="a list of objects is wanted: [{…}, …]"))
    if len(entries) > MAX_ROWS:
        raise ListError(said("csv_too_long", most=MAX_ROWS))
    found = Checked("UTF-8", "")
    seen: dict[tuple[str, ...], int] = {}
    for line, entry in enumerate(entries, 1):
        header = list(entry)
        _require_columns(kind, header if REGISTRATION in entry else [*header, *({REGISTRATION} & set(kind.columns))])
        _row(kind, header, [_cell(value) for value in entry.values()], line, seen, found)
    return found


def _cell(value: object) -> str:
    """As it would stand in a table."""
    if isinstance(value, list):
        return " ".join(map(str, value))
    return "" if value is None else str(value).strip()


def written(kind: Kind, record: Record) -> dict[str, str]:
    """What the ledger has, by columns; what it does not have (a registration number) is empty."""
    document = record.to_json()
    found = {}
    for name, column in kind.columns.items():
        value = document.get(column.field)
        found[name] = "" if value is None else column.write(value)
    return found


def _decoded(data: bytes) -> tuple[str, str]:
    for mark, encoding in _BOMS:
        if data.startswith(mark):
            return _decode(data, encoding), {"utf-8-sig": "UTF-8", "utf-16": "UTF-16"}[encoding]
    if b"\x00" in data:
        raise ListError(said("csv_no_text"))
    try:
        return data.decode("utf-8"), "UTF-8"
    except UnicodeDecodeError:
        # What offices in western Europe write otherwise; it is said, so that whoever signs looks at the names.
        return _decode(data, "cp1252"), "Windows-1252"


def _decode(data: bytes, encoding: str) -> str:
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        raise ListError(said("csv_bad_encoding", encoding=encoding, position=error.start)) from None


def _require_columns(kind: Kind, header: list[str]) -> None:
    needed = [name for name, column in kind.columns.items() if not column.optional or column.field == REGISTRATION]
    missing = [name for name in needed if name not in header]
    unknown = [name for name in header if name not in kind.columns]
    twice = sorted({name for name in header if header.count(name) > 1})
    if missing or unknown or twice:
        raise ListError(
            said(
                "csv_bad_header",
                columns=", ".join(kind.columns),
                missing=", ".join(missing) or "none",
                unknown=", ".join(name[:40] or "?" for name in unknown[:10]) or "none",
                twice=", ".join(twice[:10]) or "none",
            )
        )


def _row(
    kind: Kind, header: list[str], cells: list[str], line: int, seen: dict[tuple[str, ...], int], found: Checked
) -> None:
    if len(cells) != len(header):
        found.wrong(line, "", said("csv_cells", cells=len(cells), columns=len(header)))
        seen[str(line), ""] = line
        return
    argument: dict[str, Any] = {}
    before = len(found.errors)
    for name, cell in zip(header, cells, strict=True):
        column = kind.columns[name]
        if cell == "":
            if not column.optional:
                found.wrong(line, name, said("missing"))
            continue
        try:
            argument[column.field] = column.read(cell)
        except CellError as error:
            found.wrong(line, name, error.said)
        except OverflowError as error:
            found.wrong(line, name, str(error))
    number = argument.pop(REGISTRATION, None)
    if len(found.errors) == before:
        _check_record(kind, argument, line, found)
        if number is not None and _NUMBER.fullmatch(number) is None:
            found.wrong(line, REGISTRATION, said("csv_no_number_of_operator"))
    key = tuple(str(argument.get(name, "")) for name in kind.key)
    earlier = seen.setdefault(key if all(key) else (str(line), ""), line)
    if earlier != line:
        found.wrong(line, kind.key[-1], said("csv_same", line=earlier))
    if len(found.errors) == before:
        row = {"line": line, "id": "/".join(key), "argument": argument}
        found.rows.append(row if number is None else row | {REGISTRATION: number})


def _check_record(kind: Kind, argument: dict[str, Any], line: int, found: Checked) -> None:
    names = {column.field: name for name, column in kind.columns.items()}
    # One field after the other, so that each that is wrong is named, not the first alone.
    left = dict(argument)
    for _ in range(len(kind.columns)):
        try:
            kind.argument.parse(left)
        except RecordError as error:
            name = error.path.partition("[")[0]
            if name not in left:
                return
            found.wrong(line, names.get(name, name), error.message)
            del left[name]
        else:
            return
