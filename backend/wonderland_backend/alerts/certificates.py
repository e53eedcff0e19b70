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
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.agents.connected import Agents
from wonderland_backend.alerts import queries
from wonderland_backend.alerts.conditions import Condition
from wonderland_backend.db.tables.alerts import AlertRow
from wonderland_backend.db.tables.ledger import CertificateRow
from wonderland_backend.registry.queries.organisations import definitions, revoked_serials
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
        for each in _cas(await definitions(session))
        if each.until_ms < now_ms + EXPIRING_MS
    ]
    in_use = [
        *_of_agents(agents),
        *(_of(msp_id, name, _parsed(pem)) for msp_id, name, pem in await queries.keys_of_people(session)),
    ]
    ending = CertificateRow.not_after_ms.between(now_ms - EXPIRED_MS, now_ms + EXPIRING_MS)
    known = (
        *(_Certificate(*each) for each in await queries.certificates_on_ledger(session, ending)),
        *in_use,
        *_of_alerts(lasting),
    )
    soon = {(each.msp_id, each.serial): each for each in known if each.ends_soon(now_ms)}
    if not soon:
        return found
    revoked = await revoked_serials(session)
    latest: dict[tuple[str, str], int] = {}
    same_names = CertificateRow.name.in_({each.name for each in soon.values()})
    for each in (*(_Certificate(*each) for each in await queries.certificates_on_ledger(session, same_names)), *in_use):
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


def _cas(definitions: Iterable[tuple[str, str]]) -> list[_Certificate]:
    found = []
    for msp_id, definition in definitions:
        its = orjson.loads(definition)
        for pem in (*its.get("root_certs", ()), *its.get("intermediate_certs", ())):
            with contextlib.suppress(ValueError):  # The channel's peers judge what an MSP holds.
                found.append(_of(msp_id, "CA", certificate_of(pem.encode())))
    return found


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
