"""A list beside what the ledger has: what is new, there already, or another; and the new ones submitted, each once."""

from __future__ import annotations

import asyncio
import os
import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from wonderland.proof_contract import AwayError, ProofContract, RefusedError
from wonderland.proofs import encoding
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.schema import Record
from wonderland.proofs.registration import SALT_BYTES, Opening
from wonderland.registry.book import Book
from wonderland.registry.lists import REGISTRATION, Kind

NEW, THERE, DIFFERS, DONE, REFUSED = "new", "there already", "differs", "done", "refused"
AT_ONCE: Final = 8
"""Transactions under way at a time: one block takes them all, and a peer's limit is far away."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """One line of a list, and what became of it."""

    line: int
    id: str
    argument: Record
    opening: Opening | None = None
    """Of an operator's number, which the argument commits to."""
    state: str = NEW
    why: str = ""

    def to_json(self) -> dict[str, Any]:
        """For machines; without the number."""
        return {"line": self.line, "id": self.id, "state": self.state, "why": self.why}


class OpeningsError(Exception):
    """Numbers that could not be kept."""


def compared(kind: Kind, rows: Sequence[dict[str, Any]], book: Book, openings: Path | None) -> list[Change]:
    """Each row of a checked list beside the ledger. Raises `OpeningsError`.

    ``openings``: directory of the openings of registration numbers; one that is there is the drone's.
    """
    return [_compared(kind, row, book, openings) for row in rows]


def _compared(kind: Kind, row: dict[str, Any], book: Book, openings: Path | None) -> Change:
    argument, opening = dict(row["argument"]), None
    if REGISTRATION in row:
        if openings is None:
            raise OpeningsError("the list has registration numbers: say --openings DIR, where they are kept")
        opening = _opening(openings / f"{argument['uav_id']}.json", argument["uav_id"], row[REGISTRATION])
        argument["registration_commitment"] = opening.commitment
    change = Change(line=row["line"], id=row["id"], argument=kind.argument.parse(argument), opening=opening)
    there = recorded(kind, book, row["id"])
    if there is None:
        return change
    has = there.to_json()
    if has.get("status") == "retired" or has.get("revoked"):
        return replace(change, state=DIFFERS, why="is retired" if "status" in has else "was revoked")
    told = {name: value for name, value in change.argument.to_json().items() if name not in kind.key}
    other = [name for name, value in told.items() if has.get(name) != value]
    if not other:
        return replace(change, state=THERE)
    if kind.function == "RecordMaintenance":
        return change  # a later one follows the earlier
    why = "; ".join(
        f"{name} is {_short(has.get(name))}, not {_short(getattr(change.argument, name))}" for name in other
    )
    return replace(change, state=DIFFERS, why=why)


def recorded(kind: Kind, book: Book, name: str) -> Record | None:
    """What the ledger has under an id of a list of this kind."""
    match kind.function:
        case "RegisterPad":
            return book.pads.get(name)
        case "RegisterUav":
            return book.drones.get(name)
        case "GrantAuthorisation":
            uav_id, _, authorisation_id = name.partition("/")
            return book.authorisations.get((uav_id, authorisation_id))
        case _:
            return dict(book.maintenance()).get(name)


def _short(value: object) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 60 else f"{text[:57]}…"


def _opening(path: Path, uav_id: str, number: str) -> Opening:
    try:
        kept = Opening.decode(path.read_bytes())
    except FileNotFoundError:
        return Opening.of(uav_id, number, secrets.token_bytes(SALT_BYTES))
    except (OSError, ProofError) as error:
        raise OpeningsError(f"{path}: {error}") from None
    if (kept.uav_id, kept.registration) != (uav_id, Opening.of(uav_id, number, secrets.token_bytes(32)).registration):
        raise OpeningsError(f"{path} is of another drone or number; it was left as it is")
    return kept


def keep(opening: Opening, directory: Path) -> None:
    """Write an opening down before its commitment goes to the ledger, for its owner alone. Raises `OpeningsError`."""
    path = directory / f"{opening.uav_id}.json"
    try:
        directory.mkdir(parents=True, exist_ok=True, mode=0o700)
        with open(path, "xb", opener=lambda name, flags: os.open(name, flags, 0o600)) as file:
            file.write(encoding.encode(opening.to_json()))
            file.flush()
            os.fsync(file.fileno())
    except FileExistsError:
        return
    except OSError as error:
        raise OpeningsError(f"{path}: {error.strerror or error}") from error


async def submit_all(
    contract: ProofContract, changes: Sequence[Change], openings: Path | None, told: Callable[[Change], None]
) -> list[Change]:
    """Submit what is new, a few at a time; each one's end is told. Raises `AwayError`: then the rest was not sent.

    What was refused says why, and the others go on. To run it again submits what is still new.
    """
    waiting = asyncio.Semaphore(AT_ONCE)

    async def one(change: Change) -> Change:
        if change.state != NEW:
            return change
        async with waiting:
            if change.opening is not None and openings is not None:
                keep(change.opening, openings)
            try:
                _, committed = await contract.change(change.argument)
            except RefusedError as error:
                ended = replace(change, state=REFUSED, why=str(error))
            else:
                ended = replace(
                    change, state=DONE, why=f"transaction {committed.tx_id}, block {committed.block_number}"
                )
        told(ended)
        return ended

    try:
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(one(each)) for each in changes]
    except* AwayError as away:
        raise away.exceptions[0] from None
    except* OpeningsError as lost:
        raise lost.exceptions[0] from None
    return [each.result() for each in tasks]
