"""The real contract on a ledger in memory, for attacks on the protocol: ten thousand sessions in a minute.

What a ledger guarantees stands here in its simplest form: the creator's identity is the creator's, reads see
committed state, a refused transaction writes nothing, transactions come one after the other.
"""

from __future__ import annotations

import hashlib
from collections.abc import AsyncIterator, Coroutine, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, TypeVar

import numpy as np
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature

from wonderland.proofs import encoding
from wonderland.proofs.frame import to_wgs84
from wonderland.proofs.keys import public_bytes
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.changes import ProposedChange
from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning, OfferedPrekey
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.schema import Record
from wonderland.proofs.records.sessions import (
    AnchorRanges,
    Claim,
    Evidence,
    Radio,
    RangeTable,
    Session,
)
from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.statement import statement
from wonderland_chaincode.contract import CONTRACT
from wonderland_edge_agent.geodesy import frame_at
from wonderland_research.attack_lab.batch import LEAST_ROUNDS
from wonderland_research.attack_lab.places import (
    BIAS_SIGMA_MM,
    INSTALLATION_SIGMA_MM,
    RANGE_SIGMA_MM,
    SQUARE,
    START_MS,
    SURVEY_SIGMA_MM,
)

CHANNEL: Final = "lab"
ORDER: Final = 0xFFFFFFFF00000000FFFFFFFFFFFFFFFFBCE6FAADA7179E84F3B9CAC2FC632551
FRAME: Final = frame_at(604_518_000, 222_666_000, 30_000)
PAD_ID, OTHER_PAD_ID = "pad-1", "pad-2"
UAV_ID, OTHER_UAV_ID = "1AB0000001", "1AB0000002"
PLACE_MM: Final = (6_000, 3_000, 5_000)
ROUND_MS: Final = 50
DAY_MS: Final = 86_400_000
Place = tuple[int, int, int]
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Person:
    """A creator of transactions, and the key that the contract never sees."""

    common_name: str
    msp_id: str
    role: str
    pol_id: str = ""
    number: int = 1
    node_ou: str = "client"
    attributes: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def key(self) -> ec.EllipticCurvePrivateKey:
        """Its private key, the same in every run."""
        return ec.derive_private_key(self.number, ec.SECP256R1())

    @cached_property
    def public_key(self) -> bytes:
        """P-256, 65 B."""
        return public_bytes(self.key)

    @cached_property
    def certificate_sha256(self) -> str:
        """Stands for the certificate."""
        return hashlib.sha256(f"{self.msp_id}/{self.common_name}".encode()).hexdigest()

    def sign(self, message: bytes) -> str:
        """R ‖ s with a low s, as the records want it."""
        r, s = decode_dss_signature(self.key.sign(message, ec.ECDSA(hashes.SHA256())))
        return encoding.to_base64url(r.to_bytes(32, "big") + min(s, ORDER - s).to_bytes(32, "big"))


ADMIN: Final = Person("ada", "AuthorityMSP", "admin", number=2)
INSPECTOR: Final = Person("ines", "AuthorityMSP", "inspector", number=9)
PAD_OPERATOR: Final = Person("olga", "PadMSP", "pad_operator", number=3)
FLEET_OPERATOR: Final = Person("fred", "FleetMSP", "fleet_operator", number=4)
PAD: Final = Person("pad-1", "PadMSP", "pad", PAD_ID, number=5)
OTHER_PAD: Final = Person("pad-2", "PadMSP", "pad", OTHER_PAD_ID, number=6)
UAV: Final = Person("uav-1", "FleetMSP", "uav", UAV_ID, number=7)
OTHER_UAV: Final = Person("uav-2", "FleetMSP", "uav", OTHER_UAV_ID, number=8)
PEOPLE: Final = (ADMIN, PAD_OPERATOR, FLEET_OPERATOR, PAD, OTHER_PAD, UAV, OTHER_UAV)


class _Stub:
    """``wonderland_chaincode.stub.Stub`` over a dictionary."""

    def __init__(self, state: Mapping[str, bytes], tx_id: str, timestamp_ms: int, creator: Person) -> None:
        self._state = state
        self.channel = CHANNEL
        self.tx_id = tx_id
        self.timestamp_ms = timestamp_ms
        self.creator = creator
        self.writes: dict[str, bytes | None] = {}

    async def get(self, key: str) -> bytes | None:
        return self._state.get(key)

    async def get_many(self, keys: Sequence[str]) -> list[bytes | None]:
        return [self._state.get(key) for key in keys]

    async def put(self, key: str, value: bytes) -> None:
        self.writes[key] = value

    async def require_endorsement(self, key: str, msp_ids: Sequence[str]) -> None:
        """One process endorses here: nothing to hold."""

    async def delete(self, key: str) -> None:
        self.writes[key] = None

    async def range(self, start: str, end: str) -> AsyncIterator[tuple[str, bytes]]:
        for key in sorted(self._state, key=str.encode):
            if start.encode() <= key.encode() < end.encode():
                yield key, self._state[key]

    def history(self, key: str) -> AsyncIterator[Any]:
        del key
        return _nothing()

    def set_event(self, name: str, payload: bytes) -> None:
        """Nobody listens here."""


async def _nothing() -> AsyncIterator[Any]:
    """No attack reads what was."""
    nothing: tuple[Any, ...] = ()
    for each in nothing:
        yield each


class MemoryLedger:
    """Pads, drones and papers as for an honest landing; ``call`` raises ContractError where the contract refuses."""

    def __init__(self, rng: np.random.Generator, *, policy: Policy | None = None) -> None:
        self.rng = rng
        self.now_ms = START_MS
        self._state: dict[str, bytes] = {}
        self._count = 0
        self._salt = rng.bytes(8)
        for pad in (PAD, OTHER_PAD):
            self.call(PAD_OPERATOR, "RegisterPad", _pad(pad.pol_id))
            self.call(PAD_OPERATOR, "CommissionPad", tx.CommissionPad(pad_id=pad.pol_id, commissioning=COMMISSIONING))
        if policy is not None:
            self.approve(self.call(ADMIN, "ProposePolicy", tx.ProposePolicy(pad_id="*", action="*", policy=policy)))
        for uav_id in (UAV_ID, OTHER_UAV_ID):
            self.call(FLEET_OPERATOR, "RegisterUav", _uav(uav_id))
            self.call(FLEET_OPERATOR, "RecordMaintenance", _maintenance(uav_id))
            self.call(ADMIN, "GrantAuthorisation", _authorisation(uav_id))

    def call(self, who: Person, function: str, argument: Record) -> dict[str, Any]:
        """One transaction, committed at once."""
        self._count += 1
        tx_id = hashlib.sha256(self._salt + self._count.to_bytes(8, "big")).hexdigest()
        stub = _Stub(self._state, tx_id, self.now_ms, who)
        result: bytes = _finish(CONTRACT.invoke(stub, function, [argument.encode()]))
        for key, value in stub.writes.items():
            if value is None:
                self._state.pop(key, None)
            else:
                self._state[key] = value
        answer = encoding.decode(result, max_bytes=8 << 20)
        assert isinstance(answer, dict)
        return answer

    def approve(self, proposed: dict[str, Any], who: Person = INSPECTOR) -> ProposedChange:
        """The second pair of eyes: ApproveChange of what was proposed."""
        change = ProposedChange.parse(proposed)
        argument = tx.ApproveChange(
            change_id=change.change_id, policy=change.policy, reinstatement=change.reinstatement
        )
        return ProposedChange.parse(self.call(who, "ApproveChange", argument))

    def publish(self, prekey_id: str, *, who: Person = PAD) -> None:
        """Offer one more prekey, which the next request may take."""
        key = encoding.to_base64url(public_bytes(ec.derive_private_key(10_000 + self._count, ec.SECP256R1())))
        offered = (OfferedPrekey(prekey_id=prekey_id, public_key=key),)
        self.call(who, "PublishPrekeys", tx.PublishPrekeys(pad_id=who.pol_id, prekeys=offered))

    def request(self, prekey_id: str, claimed: Place = PLACE_MM, *, who: Person = UAV, action: str = "land") -> Session:
        """RequestProof: step 1 of a session; the session as it was written."""
        key = encoding.to_base64url(who.public_key)
        argument = tx.RequestProof(
            pad_id=PAD_ID, action=action, prekey_id=prekey_id, uav_key=key, claim=self.claim(claimed, self.now_ms)
        )
        return Session.parse(self.call(who, "RequestProof", argument))

    def submit(self, session_id: str, evidence: Evidence, *, who: Person = PAD) -> Verdict:
        """SubmitProof: step 7 of a session; the contract's verdict."""
        return Verdict.parse(self.call(who, "SubmitProof", tx.SubmitProof(session_id=session_id, evidence=evidence)))

    def claim(self, place: Place, t_ms: int) -> Claim:
        """A claim in WGS-84."""
        lat_e7, lon_e7, height_mm = to_wgs84(FRAME, *place)
        return Claim(
            lat_e7=lat_e7, lon_e7=lon_e7, height_mm=height_mm, accuracy_mm=100, height_accuracy_mm=200, t_ms=t_ms
        )

    def evidence(
        self,
        session: Session,
        *,
        truth: Place = PLACE_MM,
        claimed: Place = PLACE_MM,
        signer: Person | None = UAV,
        radio: Radio | None = None,
        matched: str = "both",
    ) -> Evidence:
        """What a pad brings of a drone that hovers at ``truth``; the clock goes on meanwhile."""
        times = [self.now_ms + 100 + ROUND_MS * index for index in range(LEAST_ROUNDS)]
        self.now_ms = times[-1] + 100
        columns = []
        for anchor in COMMISSIONING.anchors:
            away = float(np.linalg.norm(np.subtract(truth, (anchor.east_mm, anchor.north_mm, anchor.up_mm))))
            drawn = np.rint((away + self.rng.normal(0.0, RANGE_SIGMA_MM, len(times))) / 10.0) * 10.0
            columns.append(AnchorRanges(anchor_id=anchor.anchor_id, range_mm=tuple(drawn.astype(int).tolist())))
        ranges = RangeTable(t_ms=tuple(times), anchors=tuple(columns))
        claims = tuple(self.claim(claimed, t_ms) for t_ms in (times[0], times[-1]))
        signature = None
        if signer is not None:
            signature = signer.sign(statement(session.session_id, session.transcript_sha256, ranges, claims))
        return Evidence(
            ranges=ranges,
            claims=claims,
            broadcast=(),
            matched=matched,
            radio=radio or Radio(measured_by="pad", sts="provisioned"),
            steps=(),
            uav_signature=signature,
        )


COMMISSIONING: Final = Commissioning(
    frame=FRAME,
    anchors=tuple(
        Anchor(
            anchor_id=f"A{index + 1}",
            mac=0xA000 + index,
            east_mm=round(east),
            north_mm=round(north),
            up_mm=round(up),
            survey_sigma_mm=SURVEY_SIGMA_MM,
            bias=(BiasPoint(range_mm=0, bias_mm=0, sigma_mm=BIAS_SIGMA_MM),),
        )
        for index, (east, north, up) in enumerate(SQUARE.anchors)
    ),
    range_sigma_mm=RANGE_SIGMA_MM,
    installation_sigma_mm=INSTALLATION_SIGMA_MM,
    max_range_mm=100_000,
    valid_from_ms=START_MS - DAY_MS,
    valid_until_ms=START_MS + 10_000 * DAY_MS,
    method="The attack lab",
)


def _pad(pad_id: str) -> tx.RegisterPad:
    return tx.RegisterPad(
        pad_id=pad_id,
        name="Lab",
        operator_id="lab",
        lat_e7=FRAME.lat_e7,
        lon_e7=FRAME.lon_e7,
        height_mm=FRAME.height_mm,
    )


def _uav(uav_id: str) -> tx.RegisterUav:
    return tx.RegisterUav(uav_id=uav_id, operator_id="lab", model="Lab")


def _maintenance(uav_id: str) -> tx.RecordMaintenance:
    return tx.RecordMaintenance(
        uav_id=uav_id, performed_ms=START_MS - DAY_MS, valid_until_ms=START_MS + 9_000 * DAY_MS, work="100 h"
    )


def _authorisation(uav_id: str) -> tx.GrantAuthorisation:
    return tx.GrantAuthorisation(
        authorisation_id="a1",
        uav_id=uav_id,
        pad_id="*",
        actions=("land",),
        valid_from_ms=START_MS - DAY_MS,
        valid_until_ms=START_MS + 9_000 * DAY_MS,
    )


def _finish(coroutine: Coroutine[Any, Any, _Result]) -> _Result:
    """The result of a coroutine that never waits, as on the ledgers that run the contract in place."""
    try:
        coroutine.send(None)
    except StopIteration as stop:
        result: _Result = stop.value
        return result
    raise AssertionError("the contract waited for something that is not its stub")
