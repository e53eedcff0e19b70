"""Numbers in the database. None is told before it was held against the commitment in the ledger's record."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

import orjson
from sqlalchemy import and_, delete, func, or_, select, update
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.uavs import normalised_registration
from wonderland.proofs.registration import TYPE, Opening
from wonderland_backend.db.tables.ledger import DroneRow
from wonderland_backend.db.tables.numbers import RegistrationNumberRow as Row
from wonderland_backend.db.tables.signing import SignedTransactionRow
from wonderland_backend.masking import masked, sees_clearly
from wonderland_backend.person import Person

_log = logging.getLogger(__name__)

State = Literal["none", "here", "elsewhere", "altered"]
_AT_ONCE: Final = 500


@dataclass(frozen=True, slots=True)
class Number:
    """What this server has of a drone's number."""

    state: State
    msp_id: str = ""
    """The organisation that registered the drone, and had the number then."""
    opening: Opening | None = None
    """In the state `here`."""

    @property
    def value(self) -> str:
        """The number; empty in every state but `here`."""
        return "" if self.opening is None else self.opening.registration

    def shown(self, person: Person) -> dict[str, str]:
        """The RegistrationNumber of the interfaces, as this person sees it."""
        found: dict[str, str] = {"state": self.state}
        if self.opening is not None:
            value = self.opening.registration
            found["number"] = value if sees_clearly(person, self.msp_id) else masked(value)
        elif self.state == "elsewhere":
            found["held_by"] = self.msp_id
        return found


async def numbers_of(database: AsyncSession | AsyncConnection, records: Iterable[str]) -> dict[str, Number]:
    """The numbers of these drones (their records as the mirror has them, JSON), by serial number."""
    found: dict[str, Number] = {}
    asked: dict[str, list[Mapping[str, Any]]] = {}  # a commitment may be copied from another drone's record
    for text in records:
        record = orjson.loads(text)
        commitment = record.get("registration_commitment")
        msp_id = record.get("msp_id", "")
        found[record["uav_id"]] = Number("none" if commitment is None else "elsewhere", msp_id)
        if commitment is not None:
            asked.setdefault(commitment, []).append(record)
    commitments = list(asked)
    for start in range(0, len(commitments), _AT_ONCE):
        query = select(*Row.__table__.c).where(Row.commitment.in_(commitments[start : start + _AT_ONCE]))
        for row in await database.execute(query):
            for record in asked[row.commitment]:
                uav_id, msp_id = record["uav_id"], record.get("msp_id", "")
                opening = _opened(row, uav_id)
                if opening is not None:
                    found[uav_id] = Number("here", msp_id, opening)
                elif _opened(row, row.uav_id) is None:
                    _log.critical("the registration number kept for %s does not open the ledger's commitment", uav_id)
                    found[uav_id] = Number("altered", msp_id)
    return found


def _opened(row: Any, uav_id: str) -> Opening | None:
    """What a row opens its commitment with, as this drone's; None where it does not."""
    try:
        opening = Opening.parse({"type": TYPE, "uav_id": uav_id, "registration": row.number, "salt": row.salt})
    except ProofError:
        return None
    return opening if opening.commitment == row.commitment else None


async def number_of(database: AsyncSession | AsyncConnection, uav_id: str) -> Number | None:
    """The number of a drone; None where the mirror knows no such drone."""
    record = (await database.execute(select(DroneRow.record).where(DroneRow.uav_id == uav_id))).scalar_one_or_none()
    return None if record is None else (await numbers_of(database, [record]))[uav_id]


async def commitment_of(database: AsyncSession | AsyncConnection, uav_id: str) -> str | None:
    """What the ledger's record of a drone commits to, as the mirror has it."""
    record = (await database.execute(select(DroneRow.record).where(DroneRow.uav_id == uav_id))).scalar_one_or_none()
    found: str | None = None if record is None else orjson.loads(record).get("registration_commitment")
    return found


async def drones_with(database: AsyncSession, number: str) -> list[str]:
    """The drones that are registered with this whole number; its spelling and its secret do not matter."""
    query = (
        select(DroneRow.record)
        .join(Row, Row.uav_id == DroneRow.uav_id)
        .where(func.lower(Row.number) == normalised_registration(number).lower())
        .order_by(DroneRow.uav_id)
        .limit(_AT_ONCE)
    )
    found = await numbers_of(database, (await database.scalars(query)).all())
    wanted = normalised_registration(number).lower()
    return [uav_id for uav_id, each in found.items() if each.value.lower() == wanted]


async def keep(
    connection: AsyncConnection, opening: Opening, stored_by: str, now_ms: int, *, tx_id: str | None = None
) -> bool:
    """Store an opening; False where there is one of the same commitment. `tx_id`: what it waits for."""
    dialect = postgresql if connection.dialect.name == "postgresql" else sqlite
    row = {
        "commitment": opening.commitment,
        "uav_id": opening.uav_id,
        "number": opening.registration,
        "salt": opening.salt,
        "stored_ms": now_ms,
        "stored_by": stored_by,
        "tx_id": tx_id,
    }
    stored = await connection.execute(dialect.insert(Row).values(row).on_conflict_do_nothing())
    return stored.rowcount == 1


async def openings_of(connection: AsyncConnection, uav_ids: Iterable[str]) -> dict[str, Opening]:
    """What is kept for these drones, whatever the ledger says of them."""
    rows = (await connection.execute(select(*Row.__table__.c).where(Row.uav_id.in_(list(uav_ids))))).all()
    return {row.uav_id: opening for row in rows if (opening := _opened(row, row.uav_id)) is not None}


async def replace(connection: AsyncConnection, opening: Opening, stored_by: str, now_ms: int) -> None:
    """Store an opening in the place of whatever is there under its commitment; it waits for nothing."""
    await connection.execute(delete(Row).where(Row.commitment == opening.commitment))
    await keep(connection, opening, stored_by, now_ms)


async def settle(connection: AsyncConnection, tx_id: str, *, valid: bool) -> None:
    """Its transaction has ended: the number stays for good, or goes."""
    if valid:
        await connection.execute(update(Row).where(Row.tx_id == tx_id).values(tx_id=None))
    else:
        await connection.execute(delete(Row).where(Row.tx_id == tx_id))


async def sweep(
    connection: AsyncConnection, *, ended: tuple[str, ...], waiting: tuple[str, ...], before_ms: int
) -> None:
    """Delete the numbers of transactions that came to nothing: ended so, or begun before this and never signed.

    Only what is known of the transaction counts, never what the mirror lacks: it may be reading the blocks anew.
    """
    its = SignedTransactionRow
    void = select(its.tx_id).where(or_(its.state.in_(ended), and_(its.state.in_(waiting), its.created_ms < before_ms)))
    await connection.execute(delete(Row).where(Row.tx_id.in_(void)))


async def altered(database: AsyncSession, records: Iterable[str]) -> list[str]:
    """Drones whose number here does not open what these records, derived from the blocks, commit to."""
    return [uav_id for uav_id, each in (await numbers_of(database, records)).items() if each.state == "altered"]
