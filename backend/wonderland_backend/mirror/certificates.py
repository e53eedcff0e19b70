"""Certificates as they were seen on the chain: who signed and endorsed what is valid."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import msgspec

from wonderland_backend.mirror.rows import CertificateWrite, Key
from wonderland_fabric_gateway.blocks import Transaction
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.identity import Identity

_IDENTIFIER: Final = 128


def note_signers(rows: dict[Key, CertificateWrite], block: int, transaction: Transaction) -> None:
    """Add the rows of a valid transaction's creator and endorsers; the last place of each counts."""
    for identity in (transaction.creator, *transaction.endorsers):
        facts = _facts(identity.creator) if identity is not None else None
        if facts is not None:
            rows[facts.certificate_sha256,] = msgspec.structs.replace(facts, block=block, tx_index=transaction.index)


@lru_cache(maxsize=4096)
def _facts(creator: bytes) -> CertificateWrite | None:
    """What a certificate says; None where it cannot be read in full (the ledger took it all the same)."""
    identity = Identity.from_creator(creator)
    try:
        certificate = identity.certificate
        return CertificateWrite(
            certificate_sha256=identity.certificate_sha256,
            msp_id=identity.msp_id[:_IDENTIFIER],
            name=_text(identity.common_name),
            node_ou=identity.node_ou,
            role=_text(identity.role),
            pol_id=_text(identity.pol_id),
            serial=f"{certificate.serial_number:x}",
            not_before_ms=int(certificate.not_valid_before_utc.timestamp() * 1000),
            not_after_ms=int(certificate.not_valid_after_utc.timestamp() * 1000),
        )
    except (LedgerError, ValueError):
        return None


def _text(value: str) -> str:
    return value.replace("\x00", "\ufffd")[:_IDENTIFIER]
