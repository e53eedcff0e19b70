"""Organisations and certificates: from the channel's configuration, and as they were seen on the chain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import orjson
from cryptography import x509
from sqlalchemy import ColumnElement, func, or_, select, tuple_
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.db.tables.ledger import CertificateRow, DroneRow, OrganisationRow, PadRow
from wonderland_backend.person import Person
from wonderland_backend.registry.schemas import CertificateQuery
from wonderland_fabric_gateway.certificates import certificate_of, revocation_list_of

EXPIRING_MS: Final = 30 * 86_400_000
_CERTIFICATE: Final = (
    "certificate_sha256",
    "msp_id",
    "name",
    "node_ou",
    "role",
    "pol_id",
    "serial",
    "not_before_ms",
    "not_after_ms",
)


async def organisations(database: AsyncSession) -> list[dict[str, Any]]:
    """The RegistryOrganisations, by MSP id."""
    counts = {table: await _count(database, table) for table in (PadRow, DroneRow, CertificateRow)}
    rows = await database.scalars(select(OrganisationRow).order_by(OrganisationRow.msp_id))
    return [_shown(row, counts) for row in rows]


async def _count(database: AsyncSession, table: Any) -> dict[str, int]:
    found = await database.execute(select(table.msp_id, func.count()).group_by(table.msp_id))
    return {row[0]: row[1] for row in found}


def _shown(row: OrganisationRow, counts: dict[Any, dict[str, int]]) -> dict[str, Any]:
    definition = orjson.loads(row.definition)
    pems = [*definition["root_certs"], *definition["intermediate_certs"]]
    return {
        "msp_id": row.msp_id,
        "application": "Application" in definition["sections"],
        "authorities": [_authority(pem) for pem in pems],
        "revoked": len(_revoked(definition)),
        "pads": counts[PadRow].get(row.msp_id, 0),
        "drones": counts[DroneRow].get(row.msp_id, 0),
        "certificates": counts[CertificateRow].get(row.msp_id, 0),
        "version": {"block": row.block, "tx_index": row.tx_index},
    }


def _authority(pem: str) -> dict[str, Any]:
    certificate = certificate_of(pem.encode())
    names = certificate.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
    return {
        "name": str(names[0].value) if names else certificate.subject.rfc4514_string(),
        "not_after_ms": int(certificate.not_valid_after_utc.timestamp() * 1000),
        "serial": f"{certificate.serial_number:x}",
    }


def _revoked(definition: dict[str, Any]) -> set[str]:
    """Serial numbers (hexadecimal) on an organisation's revocation lists."""
    return {
        f"{entry.serial_number:x}"
        for pem in definition["revocation_lists"]
        for entry in revocation_list_of(pem.encode())
    }


async def revoked_serials(database: AsyncSession) -> dict[str, set[str]]:
    """For each organisation the serial numbers (hexadecimal) on its revocation lists."""
    return {msp_id: _revoked(orjson.loads(definition)) for msp_id, definition in await definitions(database)}


async def certificates(
    database: AsyncSession, person: Person, filters: CertificateQuery, place: tuple[Any, ...] | None, now_ms: int
) -> Sequence[CertificateRow]:
    """Certificates that fit, those that end first first; one more than asked for where there are more."""
    query = select(CertificateRow)
    if not person.scope.everything:
        query = query.where(CertificateRow.msp_id == person.msp_id, CertificateRow.msp_id != "")
    if filters.q is not None:
        query = query.where(or_(*(_contains(each, filters.q) for each in (CertificateRow.name, CertificateRow.pol_id))))
    if filters.msp is not None:
        query = query.where(CertificateRow.msp_id == filters.msp)
    if filters.role is not None:
        query = query.where(CertificateRow.role == filters.role)
    if filters.expiring:
        query = query.where(CertificateRow.not_after_ms < now_ms + EXPIRING_MS)
    order = (CertificateRow.not_after_ms, CertificateRow.certificate_sha256)
    if place is not None:
        query = query.where(tuple_(*order) > place)
    return (await database.scalars(query.order_by(*order).limit(filters.limit + 1))).all()


def shown_certificate(row: CertificateRow, revoked: dict[str, set[str]], now_ms: int) -> dict[str, Any]:
    """The RegistryCertificate of a row."""
    state = "valid"
    if row.serial in revoked.get(row.msp_id, ()):
        state = "revoked"
    elif row.not_after_ms <= now_ms:
        state = "expired"
    elif row.not_after_ms < now_ms + EXPIRING_MS:
        state = "expiring"
    return {name: getattr(row, name) for name in _CERTIFICATE} | {"state": state, "last_block": row.block}


def _contains(column: Any, text: str) -> ColumnElement[bool]:
    return func.lower(column).contains(text.lower(), autoescape=True)


async def definitions(session: AsyncSession) -> list[tuple[str, str]]:
    """Each organisation, and its definition (JSON) in the channel's configuration."""
    rows = await session.execute(select(OrganisationRow.msp_id, OrganisationRow.definition))
    return [(row[0], row[1]) for row in rows]
