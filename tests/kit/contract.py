"""An in-memory ledger for the contract, people with keys, and a pad and a drone in front of it."""

from __future__ import annotations

import hashlib
import math
import random
from collections.abc import AsyncIterator, Callable, Collection, Coroutine, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import pytest
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature

from wonderland.proofs import encoding
from wonderland.proofs.frame import to_wgs84
from wonderland.proofs.keys import public_bytes
from wonderland.proofs.records.sessions import Claim, RangeTable
from wonderland.proofs.statement import statement
from wonderland_chaincode.contract import CONTRACT, ContractError
from wonderland_edge_agent.geodesy import frame_at

START_MS = 1_800_000_000_000
ORDER = 0xFFFFFFFF00000000FFFFFFFFFFFFFFFFBCE6FAADA7179E84F3B9CAC2FC632551
FRAME = frame_at(604_518_000, 222_666_000, 30_000)
ANCHORS = {"A0": (1500, 1500, 1200), "A1": (-1500, 1500, 200), "A2": (-1500, -1500, 200), "A3": (1500, -1500, 200)}
HERE = (2_000, 1_000, 1_500)
"""Where the drone says that it is, in the pad's frame (mm)."""


def finish(coroutine: Coroutine[Any, Any, Any]) -> Any:
    """The result of a coroutine that never waits, as on the ledgers that run the contract in place."""
    try:
        coroutine.send(None)
    except StopIteration as stop:
        return stop.value
    coroutine.close()
    raise AssertionError("the contract waited for something")


def private_key(number: int) -> ec.EllipticCurvePrivateKey:
    return ec.derive_private_key(number, ec.SECP256R1())


def point(number: int) -> str:
    return encoding.to_base64url(public_bytes(private_key(number)))


@dataclass(frozen=True)
class Person:
    """A creator, with the key that the stub would not show."""

    common_name: str
    msp_id: str
    role: str
    pol_id: str = ""
    node_ou: str = "client"
    attributes: Mapping[str, str] = field(default_factory=dict)
    number: int = 1

    @property
    def key(self) -> ec.EllipticCurvePrivateKey:
        return private_key(self.number)

    @property
    def public_key(self) -> bytes:
        return public_bytes(self.key)

    @property
    def certificate_sha256(self) -> str:
        return hashlib.sha256(f"{self.msp_id}/{self.common_name}".encode()).hexdigest()

    def sign(self, message: bytes) -> bytes:
        r, s = decode_dss_signature(self.key.sign(message, ec.ECDSA(hashes.SHA256())))
        return r.to_bytes(32, "big") + min(s, ORDER - s).to_bytes(32, "big")


@dataclass(frozen=True)
class Change:
    tx_id: str
    timestamp_ms: int
    value: bytes
    is_delete: bool


class MemoryStub:
    """Committed state in, writes and event out."""

    def __init__(self, state: Mapping[str, bytes], past: Mapping[str, list[Change]], **facts: Any) -> None:
        self._state, self._past = state, past
        self.channel: str = facts["channel"]
        self.tx_id: str = facts["tx_id"]
        self.timestamp_ms: int = facts["timestamp_ms"]
        self.creator: Person = facts["creator"]
        self.writes: dict[str, bytes | None] = {}
        self.endorsers: dict[str, tuple[str, ...]] = {}
        self.event: tuple[str, bytes] | None = None
        self.reads = 0

    async def get(self, key: str) -> bytes | None:
        self.reads += 1
        return self._state.get(key)

    async def get_many(self, keys: Sequence[str]) -> list[bytes | None]:
        return [await self.get(key) for key in keys]

    async def put(self, key: str, value: bytes) -> None:
        assert isinstance(value, bytes)
        self.writes[key] = value

    async def require_endorsement(self, key: str, msp_ids: Sequence[str]) -> None:
        assert self.writes[key] is not None
        self.endorsers[key] = tuple(msp_ids)

    async def delete(self, key: str) -> None:
        self.writes[key] = None

    async def range(self, start: str, end: str) -> AsyncIterator[tuple[str, bytes]]:
        for key in sorted(self._state, key=lambda key: key.encode()):
            if start.encode() <= key.encode() < end.encode():
                self.reads += 1
                yield key, self._state[key]

    async def history(self, key: str) -> AsyncIterator[Change]:
        for change in reversed(self._past.get(key, [])):
            self.reads += 1
            yield change

    def set_event(self, name: str, payload: bytes) -> None:
        self.event = name, payload


class Ledger:
    """Commits each transaction at once."""

    channel = "pol"

    def __init__(self) -> None:
        self.state: dict[str, bytes] = {}
        self.past: dict[str, list[Change]] = {}
        self.endorsers: dict[str, tuple[str, ...]] = {}
        self.events: list[tuple[str, dict[str, Any]]] = []
        self.now_ms = START_MS
        self.count = 0
        self.last: MemoryStub | None = None
        self.tx_id = ""

    def stub(self, who: Person) -> MemoryStub:
        self.count += 1
        self.tx_id = hashlib.sha256(b"tx %d" % self.count).hexdigest()
        return MemoryStub(
            self.state,
            self.past,
            channel=self.channel,
            tx_id=self.tx_id,
            timestamp_ms=self.now_ms,
            creator=who,
        )

    def raw(self, who: Person, function: str, args: list[bytes]) -> bytes:
        stub = self.last = self.stub(who)
        before = dict(self.state)
        try:
            result: bytes = finish(CONTRACT.invoke(stub, function, args))
        finally:
            assert self.state == before  # nothing is written but by the commit
        self.endorsers.update(stub.endorsers)
        for key, value in stub.writes.items():
            change = Change(stub.tx_id, stub.timestamp_ms, value or b"", value is None)
            self.past.setdefault(key, []).append(change)
            if value is None:
                self.state.pop(key, None)
                self.endorsers.pop(key, None)
            else:
                self.state[key] = value
        if stub.event is not None:
            self.events.append((stub.event[0], encoding.decode(stub.event[1])))
            assert encoding.encode(self.events[-1][1]) == stub.event[1]
        return result

    def call(self, who: Person, function: str, argument: Mapping[str, Any] | None = None, /, **fields: Any) -> Any:
        """The answer to one transaction or query."""
        result = self.raw(who, function, [encoding.encode({**(argument or {}), **fields})])
        value = encoding.decode(result, max_bytes=8 << 20)
        assert encoding.encode(value) == result
        return value

    def refuse(
        self, status: int, code: str, who: Person, function: str, argument: Mapping[str, Any] | None = None, /, **fields
    ) -> ContractError:
        """The refusal of one transaction, with this status and code, and no writes."""
        events = len(self.events)
        with pytest.raises(ContractError) as caught:
            self.call(who, function, argument, **fields)
        error = caught.value
        assert (error.status, error.code) == (status, code), str(error)
        assert str(error).startswith(f"{code}: ")
        assert len(str(error)) > len(code) + 12
        assert len(self.events) == events
        return error


class Scene(Ledger):
    """People, a pad that is commissioned and a drone that may land, as far as a test asks for them."""

    admin = Person("ada", "AuthorityMSP", "admin")
    inspector = Person("ines", "AuthorityMSP", "inspector", number=2)
    mirror = Person("mira", "AuthorityMSP", "mirror")
    operator = Person("olga", "PadMSP", "pad_operator")
    other_operator = Person("oscar", "OtherPadMSP", "pad_operator")
    pad = Person("pad-1", "PadMSP", "pad", "pad-1", number=11)
    other_pad = Person("pad-2", "PadMSP", "pad", "pad-2", number=12)
    fleet = Person("fred", "FleetMSP", "fleet_operator")
    other_fleet = Person("frida", "OtherFleetMSP", "fleet_operator")
    uav = Person("uav-1", "FleetMSP", "uav", "1AB0000001", number=21)
    other_uav = Person("uav-2", "FleetMSP", "uav", "1AB0000002", number=22)
    frame = FRAME
    start_ms = START_MS

    point = staticmethod(point)
    person = staticmethod(replace)

    # records

    def pad_argument(self, pad_id: str = "pad-1", **more: Any) -> dict[str, Any]:
        return {
            "pad_id": pad_id,
            "name": "Roof",
            "operator_id": "harbour",
            "lat_e7": 604_000_000,
            "lon_e7": 222_000_000,
            "height_mm": 1,
        } | more

    def commissioning(self, **more: Any) -> dict[str, Any]:
        return {
            "frame": FRAME.to_json(),
            "anchors": [
                {
                    "anchor_id": name,
                    "mac": 0xA000 + index,
                    "east_mm": east,
                    "north_mm": north,
                    "up_mm": up,
                    "survey_sigma_mm": 3,
                    "bias": [{"range_mm": 0, "bias_mm": 0, "sigma_mm": 5}],
                }
                for index, (name, (east, north, up)) in enumerate(ANCHORS.items())
            ],
            "range_sigma_mm": 25,
            "installation_sigma_mm": 5,
            "max_range_mm": 100_000,
            "valid_from_ms": START_MS - 1000,
            "valid_until_ms": START_MS + 10**10,
            "method": "tape",
        } | more

    def uav_argument(self, uav_id: str = "1AB0000001", **more: Any) -> dict[str, Any]:
        return {"uav_id": uav_id, "operator_id": "fleet", "registration_commitment": "5a" * 32, "model": "Quad"} | more

    def authorisation(self, **more: Any) -> dict[str, Any]:
        return {
            "authorisation_id": "a1",
            "uav_id": "1AB0000001",
            "pad_id": "pad-1",
            "actions": ["land"],
            "valid_from_ms": START_MS,
            "valid_until_ms": START_MS + 10**9,
        } | more

    def maintenance(self, **more: Any) -> dict[str, Any]:
        return {
            "uav_id": "1AB0000001",
            "performed_ms": START_MS - 1000,
            "valid_until_ms": START_MS + 10**9,
            "work": "100 h",
        } | more

    def calibration(self, *session_ids: str, **more: Any) -> dict[str, Any]:
        return {
            "uav_id": "1AB0000001",
            "pad_id": "pad-1",
            "offset_mm": 300,
            "sigma_mm": 20,
            "sessions": [
                {"session_id": each, "east_mm": HERE[0], "north_mm": HERE[1], "up_mm": HERE[2]} for each in session_ids
            ],
            "valid_until_ms": START_MS + 10**9,
        } | more

    def claim(self, local: tuple[int, int, int] = HERE, **more: Any) -> dict[str, Any]:
        lat, lon, height = to_wgs84(FRAME, *local)
        return {
            "lat_e7": lat,
            "lon_e7": lon,
            "height_mm": height,
            "accuracy_mm": 100,
            "height_accuracy_mm": 200,
            "t_ms": self.now_ms,
        } | more

    def request_argument(self, prekey_id: str = "k1", **more: Any) -> dict[str, Any]:
        return {
            "pad_id": "pad-1",
            "action": "land",
            "prekey_id": prekey_id,
            "uav_key": point(900),
            "claim": self.claim(),
        } | more

    def evidence(
        self,
        session: Mapping[str, Any],
        truth: tuple[int, int, int] = HERE,
        claimed: tuple[int, int, int] = HERE,
        *,
        rounds: int = 40,
        signer: Person | None = None,
        astray: Collection[int] = (),
        silent: Callable[[int, int], bool] = lambda *_: False,
        delay_mm: int = 0,
        **more: Any,
    ) -> dict[str, Any]:
        """What the pad would bring of a drone that hovers at ``truth`` and claims ``claimed``, countersigned.

        ``astray``: which of its claims (one in four rounds) are 7.5 m to the east of that. ``silent(anchor, round)``:
        whether an anchor measures nothing in a round, both by their numbers. ``delay_mm``: what its node adds to ranges.
        """
        noise = random.Random(rounds)
        times = [self.now_ms + 100 + 50 * index for index in range(rounds)]
        aside = (claimed[0] + 7_500, *claimed[1:])
        claims = [
            self.claim(aside if number in astray else claimed, t_ms=t_ms) for number, t_ms in enumerate(times[::4])
        ]
        ranges = {
            "t_ms": times,
            "anchors": [
                {
                    "anchor_id": name,
                    "range_mm": [
                        -1 if silent(index, number) else round(math.dist(truth, at) + delay_mm + noise.gauss(0, 25))
                        for number in range(rounds)
                    ],
                }
                for index, (name, at) in enumerate(ANCHORS.items())
            ],
        }
        message = statement(
            session["session_id"],
            session["transcript_sha256"],
            RangeTable.parse(ranges),
            tuple(Claim.parse(claim) for claim in claims),
        )
        self.now_ms = times[-1] + 100 if times else self.now_ms
        return {
            "ranges": ranges,
            "claims": claims,
            "broadcast": [],
            "matched": "both",
            "radio": {"measured_by": "pad", "sts": "provisioned"},
            "steps": [],
            "uav_signature": encoding.to_base64url((signer or self.uav).sign(message)),
        } | more

    # what two people do

    def set_policy(self, policy: Mapping[str, Any], pad_id: str = "*", action: str = "*") -> dict[str, Any]:
        """Proposed by the administrator, approved by the inspector."""
        proposed = self.call(self.admin, "ProposePolicy", pad_id=pad_id, action=action, policy=policy)
        return self.approve(proposed)

    def reinstate(self, uav_id: str = "1AB0000001") -> dict[str, Any]:
        return self.approve(self.call(self.admin, "ProposeReinstatement", uav_id=uav_id, reason="inspected"))

    def approve(self, proposed: Mapping[str, Any], who: Person | None = None) -> dict[str, Any]:
        approved: dict[str, Any] = self.call(who or self.inspector, "ApproveChange", self.approval(proposed))
        return approved

    @staticmethod
    def approval(proposed: Mapping[str, Any]) -> dict[str, Any]:
        return {name: proposed[name] for name in ("change_id", "policy", "reinstatement") if name in proposed}

    # what has to happen before

    def with_pad(self) -> Scene:
        self.call(self.operator, "RegisterPad", self.pad_argument())
        self.call(self.operator, "CommissionPad", pad_id="pad-1", commissioning=self.commissioning())
        return self

    def with_prekeys(self, *prekey_ids: str) -> Scene:
        offered = [
            {"prekey_id": prekey_id, "public_key": point(1000 + self.count * 10 + index)}
            for index, prekey_id in enumerate(prekey_ids)
        ]
        self.call(self.pad, "PublishPrekeys", pad_id="pad-1", prekeys=offered)
        return self

    def with_uav(self) -> Scene:
        self.call(self.fleet, "RegisterUav", self.uav_argument())
        self.call(self.fleet, "RecordMaintenance", self.maintenance())
        return self

    def ready(self) -> Scene:
        """All that an honest landing needs, three prekeys included."""
        self.with_pad().with_prekeys("k1", "k2", "k3").with_uav()
        self.call(self.admin, "GrantAuthorisation", self.authorisation())
        return self

    def request(self, prekey_id: str = "k1", **more: Any) -> dict[str, Any]:
        session: dict[str, Any] = self.call(self.uav, "RequestProof", self.request_argument(prekey_id, **more))
        return session

    def submit(self, session: Mapping[str, Any], evidence: Mapping[str, Any] | None = None) -> dict[str, Any]:
        verdict: dict[str, Any] = self.call(
            self.pad,
            "SubmitProof",
            session_id=session["session_id"],
            evidence=self.evidence(session) if evidence is None else evidence,
        )
        return verdict
