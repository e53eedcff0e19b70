"""Certificates that end soon: of CAs, of whoever signed on the ledger, of officers' browsers, of connected agents.

A certificate that was revoked, or that its holder has replaced by a later one, may end in peace.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from typing import Final

import orjson
from cryptography import x509
from sqlalchemy import ColumnElement, select
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.agents.connected import Agents
from wonderland_backend.alerts.conditions import Condition
from wonderland_backend.db.tables.alerts import AlertRow
from wonderland_backend.db.tables.ledger import CertificateRow, OrganisationRow
from wonderland_backend.db.tables.signing import SigningKeyRow
from wonderland_backend.registry.organisations import revoked_serials
from wonderland_fabric_gateway.certificates import certificate_of
from wonderland_fabric_gateway.errors import IdentityError
from wonderland_fabric_gateway.identity import Identity

KIND: Final = "certificate_expiring"
EXPIRING_MS: Final = 14 * 86_400_000
EXPIRED_MS: Final = 14 * 86_400_000
"""Whoever has not replaced a certificate so long after its end needs none any more; CAs are always needed."""


@dataclass(frozen=True)
class _Certificate:
    msp_id: str
    name: str
    serial: str
    """Hexadecimal."""
    until_ms: int

    @property
    def holder(self) -> tuple[str, str]:
        return self.msp_id, self.name

    def ends_soon(self, now_ms: int) -> bool:
        return now_ms - EXPIRED_MS < self.until_ms < now_ms + EXPIRING_MS


async def conditions(
    session: AsyncSession, agents: Agents, lasting: Iterable[AlertRow], now_ms: int
) -> list[Condition]:
    """One for each certificate that ends soon, by its serial number.

    `lasting`: alerts that are not over. An agent whose connection ended has its certificate still.
    """
    found = [
        _condition(each, f"{each.msp_id} CA", now_ms)
        for each in await _cas(session)
        if each.until_ms < now_ms + EXPIRING_MS
    ]
    in_use = [*_of_agents(agents), *await _of_browsers(session)]
    ending = CertificateRow.not_after_ms.between(now_ms - EXPIRED_MS, now_ms + EXPIRING_MS)
    known = (*await _on_ledger(session, ending), *in_use, *_of_alerts(lasting))
    soon = {(each.msp_id, each.serial): each for each in known if each.ends_soon(now_ms)}
    if not soon:
        return found
    revoked = await revoked_serials(session)
    latest: dict[tuple[str, str], int] = {}
    same_names = CertificateRow.name.in_({each.name for each in soon.values()})
    for each in (*await _on_ledger(session, same_names), *in_use):
        if each.serial not in revoked.get(each.msp_id, ()):
            latest[each.holder] = max(latest.get(each.holder, 0), each.until_ms)
    for each in soon.values():
        is_replaced = latest.get(each.holder, 0) > each.until_ms
        if not is_replaced and each.serial not in revoked.get(each.msp_id, ()):
            found.append(_condition(each, f"{each.name} ({each.msp_id})", now_ms))
    return found


def _condition(certificate: _Certificate, who: str, now_ms: int) -> Condition:
    facts = {"who": who, **asdict(certificate)}
    return Condition(KIND, f"{certificate.msp_id}/{certificate.serial}", now_ms, None, facts)


async def _on_ledger(session: AsyncSession, which: ColumnElement[bool]) -> list[_Certificate]:
    columns = (CertificateRow.msp_id, CertificateRow.name, CertificateRow.serial, CertificateRow.not_after_ms)
    return [_Certificate(*row) for row in await session.execute(select(*columns).where(which))]


async def _cas(session: AsyncSession) -> list[_Certificate]:
    found = []
    for msp_id, definition in await session.execute(select(OrganisationRow.msp_id, OrganisationRow.definition)):
        its = orjson.loads(definition)
        for pem in (*its.get("root_certs", ()), *its.get("intermediate_certs", ())):
            with contextlib.suppress(ValueError):  # The channel's peers judge what an MSP holds.
                found.append(_of(msp_id, "CA", certificate_of(pem.encode())))
    return found


async def _of_browsers(session: AsyncSession) -> list[_Certificate]:
    """Those that people sign with, also before they first do."""
    columns = (SigningKeyRow.msp_id, SigningKeyRow.name, SigningKeyRow.certificate)
    rows = await session.execute(select(*columns).where(SigningKeyRow.ended_ms.is_(None)))
    return [_of(msp_id, name, _parsed(pem)) for msp_id, name, pem in rows]


def _of_agents(agents: Agents) -> Iterable[_Certificate]:
    for agent in agents:
        with contextlib.suppress(IdentityError):
            identity = Identity.from_creator(agent.creator)
            yield _of(identity.msp_id, identity.common_name, identity.certificate)


def _of_alerts(alerts: Iterable[AlertRow]) -> Iterable[_Certificate]:
    for alert in alerts:
        facts = orjson.loads(alert.facts) if alert.kind == KIND else {}
        if "serial" in facts:
            yield _Certificate(*(facts[each.name] for each in fields(_Certificate)))


@lru_cache(maxsize=1024)
def _parsed(pem: str) -> x509.Certificate:
    return certificate_of(pem.encode())


def _of(msp_id: str, name: str, certificate: x509.Certificate) -> _Certificate:
    until_ms = int(certificate.not_valid_after_utc.timestamp() * 1000)
    return _Certificate(msp_id, name, f"{certificate.serial_number:x}", until_ms)
