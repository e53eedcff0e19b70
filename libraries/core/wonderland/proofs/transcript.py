"""What a session is bound to: everything that both sides know from the ledger before a radio speaks.

Its digest salts the derivation of the keys (``keys``) and stands in the statement that the drone countersigns
(``statement``), so that keys and signature hold for this request, these parties, this survey and this contract only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from wonderland.proofs import encoding
from wonderland.proofs.records.calibrations import DroneOffset
from wonderland.proofs.records.fields import (
    Action,
    MspId,
    PadId,
    PrekeyId,
    PublicKey,
    SessionId,
    Sha256Hex,
    TimeMs,
    UavId,
)
from wonderland.proofs.records.radios import NodeAbility
from wonderland.proofs.records.schema import Choice, Record, Text
from wonderland.proofs.records.sessions import Session, Witness

PROTOCOL: Final = "wonderland/1"
SUITE: Final = "P256-HKDF-SHA256-AESCCM8"
STS: Final = "provisioned"


@dataclass(frozen=True, kw_only=True, slots=True)
class Transcript(Record):
    """The facts of a session before ranging."""

    protocol: Annotated[str, Choice((PROTOCOL,))]
    suite: Annotated[str, Choice((SUITE,))]
    channel: Annotated[str, Text(249, r"[a-z][a-z0-9.-]*", "Channel of the ledger", min_length=1)]
    contract: Annotated[str, Text(64, r"[A-Za-z0-9._-]+", "Name of the contract")]
    contract_version: Annotated[str, Text(32, r"[0-9A-Za-z.+-]+")]
    request_tx: SessionId
    pad_id: PadId
    uav_id: UavId
    action: Action
    prekey_id: PrekeyId
    pad_msp: MspId
    pad_certificate_sha256: Sha256Hex
    uav_msp: MspId
    uav_certificate_sha256: Sha256Hex
    pad_key: PublicKey
    uav_key: PublicKey
    commissioning_sha256: Sha256Hex
    expires_ms: TimeMs
    sts: Annotated[str, Choice((STS,))]
    witness: Witness | None = None
    node: NodeAbility | None = None
    """The drone's; the pad's nodes stand in its commissioning. Both together give the radio plan (``uwb.agreed``)."""
    calibration: DroneOffset | None = None

    def digest(self) -> bytes:
        """SHA-256 of the canonical encoding (32 B)."""
        return encoding.digest(self.to_json())


def transcript_of(session: Session, channel: str, *, contract: str = "pol") -> Transcript:
    """The transcript of a session as the ledger holds it; its own ``transcript_sha256`` takes no part."""
    return Transcript(
        protocol=PROTOCOL,
        suite=SUITE,
        channel=channel,
        contract=contract,
        contract_version=session.contract_version,
        request_tx=session.session_id,
        pad_id=session.pad_id,
        uav_id=session.uav_id,
        action=session.action,
        prekey_id=session.prekey_id,
        pad_msp=session.pad.msp_id,
        pad_certificate_sha256=session.pad.certificate_sha256,
        uav_msp=session.uav.msp_id,
        uav_certificate_sha256=session.uav.certificate_sha256,
        pad_key=session.pad_key,
        uav_key=session.uav_key,
        commissioning_sha256=session.commissioning_sha256,
        expires_ms=session.expires_ms,
        sts=STS,
        witness=session.witness,
        node=session.node,
        calibration=session.calibration,
    )
