"""Pads and drones whose proofs need nothing but the ledger: ranges, claims and prekeys are prepared, the rest is real."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass, replace

from cryptography.hazmat.primitives.asymmetric import ec

from kit.proof_world import START_MS, World
from wonderland.proofs import encoding
from wonderland.proofs.frame import to_wgs84
from wonderland.proofs.keys import public_bytes
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.changes import ProposedChange
from wonderland.proofs.records.pads import OfferedPrekey
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.statement import statement
from wonderland_edge_agent.geodesy import frame_at
from wonderland_fabric_gateway.gateway import EndorseError, Gateway
from wonderland_fabric_gateway.signing import raw_from_der

PADS = 4
DRONES = 8
ROUNDS = 20
FRAME = frame_at(604_518_000, 222_666_000, 30_000)
HERE = (3_000, 6_000, 4_000)
DAY_MS = 86_400_000


@dataclass(frozen=True)
class Prepared:
    """A session that only has to be asked for: which prekey of which pad, and the drone's own key."""

    pad_id: str
    prekey_id: str
    uav_id: str
    uav_key: str


class Actors:
    """Pads and drones with their contracts and the ranges that they will bring."""

    def __init__(self, connection, channel):
        self._connection = connection
        self._channel = channel
        self._contracts = {}
        world = World(seed=11)
        self.commissioning = replace(world.commissioning, frame=FRAME)
        lat_e7, lon_e7, height_mm = to_wgs84(FRAME, *HERE)
        self.here = {"lat_e7": lat_e7, "lon_e7": lon_e7, "height_mm": height_mm}
        self.claim = replace(world.claim(HERE, START_MS), **self.here)
        self.evidence = [
            world.evidence(lambda t: HERE, lambda t: HERE, rounds=ROUNDS, broadcast=lambda t: HERE) for _ in range(16)
        ]
        self.signers = {}

    def contract(self, name):
        if name not in self._contracts:
            gateway = Gateway(self._channel, self._connection.identity(name), self._connection.signer(name))
            self._contracts[name] = gateway.network(self._connection.channel).contract(self._connection.chaincode)
            self.signers[name] = self._connection.signer(name)
        return self._contracts[name]

    async def submit(self, name, function, argument):
        return await self.contract(name).submit_with_retry(function, argument.encode())

    async def register(self, now_ms, pads=PADS, drones=DRONES):
        for index in range(pads):
            pad_id = f"pad-{index}"
            await self.submit_known(
                "pad_operator",
                "RegisterPad",
                tx.RegisterPad(
                    pad_id=pad_id,
                    name=pad_id,
                    operator_id="bench",
                    lat_e7=FRAME.lat_e7,
                    lon_e7=FRAME.lon_e7,
                    height_mm=FRAME.height_mm,
                ),
            )
            await self.submit_known(
                "pad_operator", "CommissionPad", tx.CommissionPad(pad_id=pad_id, commissioning=self.commissioning)
            )
        policy = Policy(min_assurance=2, max_claim_age_ms=60_000)
        proposal = tx.ProposePolicy(pad_id="*", action="*", policy=policy)
        proposed = ProposedChange.decode((await self.submit_known("admin", "ProposePolicy", proposal)).payload)
        approval = tx.ApproveChange(change_id=proposed.change_id, policy=proposed.policy)
        await self.submit_known("inspector", "ApproveChange", approval)
        for index in range(drones):
            uav_id = f"uav-{index}"
            await self.submit_known(
                "fleet_operator",
                "RegisterUav",
                tx.RegisterUav(uav_id=uav_id, operator_id="bench", model="Bench"),
            )
            await self.submit_known(
                "fleet_operator",
                "RecordMaintenance",
                tx.RecordMaintenance(
                    uav_id=uav_id, performed_ms=now_ms - DAY_MS, valid_until_ms=now_ms + DAY_MS, work="Inspection"
                ),
            )
            await self.submit_known(
                "admin",
                "GrantAuthorisation",
                tx.GrantAuthorisation(
                    authorisation_id="bench",
                    uav_id=uav_id,
                    pad_id="*",
                    actions=("land",),
                    valid_from_ms=now_ms - DAY_MS,
                    valid_until_ms=now_ms + DAY_MS,
                ),
            )

    async def prepare(self, count, pads=PADS, drones=DRONES):
        """Prekeys on the ledger, a hundred a transaction, and a key for each drone's session."""
        # A few keys serve for all: what is new on the ledger is the prekey's id, and points cost time to make.
        points = [encoding.to_base64url(public_bytes(ec.generate_private_key(ec.SECP256R1()))) for _ in range(100)]
        each = -(-count // pads)
        for pad in range(pads):
            for first in range(0, each, 100):
                keys = tuple(
                    OfferedPrekey(prekey_id=f"k{number}", public_key=points[number % 100])
                    for number in range(first, min(first + 100, each))
                )
                await self.submit_known(
                    f"pad-{pad}", "PublishPrekeys", tx.PublishPrekeys(pad_id=f"pad-{pad}", prekeys=keys)
                )
        return [
            Prepared(f"pad-{number % pads}", f"k{number // pads}", f"uav-{number % drones}", points[number % 100])
            for number in range(count)
        ]

    async def prove(self, prepared, number):
        """Steps 1, 6 and 7; returns milliseconds and the verdict."""
        start = time.perf_counter()
        now_ms = time.time_ns() // 1_000_000
        request = self.request(prepared, now_ms)
        done = await self.submit_known(prepared.uav_id, "RequestProof", request)
        argument = self.proof(prepared, number, now_ms, done)
        done = await self.submit_known(prepared.pad_id, "SubmitProof", argument)
        return (time.perf_counter() - start) * 1e3, encoding.decode(done.payload)

    async def submit_known(self, name, function, argument):
        """Submit what concerns records that are on the ledger: a peer that does not know them is a block behind."""
        while True:
            try:
                return await self.submit(name, function, argument)
            except EndorseError as error:
                refusal = error.chaincode_response
                if refusal is None or refusal.status != 404:
                    raise
            await asyncio.sleep(0.005)

    def request(self, prepared, now_ms):
        """Step 1."""
        return tx.RequestProof(
            pad_id=prepared.pad_id,
            action="land",
            prekey_id=prepared.prekey_id,
            uav_key=prepared.uav_key,
            claim=replace(self.claim, t_ms=now_ms),
        )

    def proof(self, prepared, number, now_ms, requested):
        """Steps 6 and 7: the ranges, countersigned by the drone. ``requested``: the committed request."""
        session = encoding.decode(requested.payload)
        evidence = self.measured(number, now_ms)
        self.contract(prepared.uav_id)  # its signer
        said = statement(requested.tx_id, session["transcript_sha256"], evidence.ranges, evidence.claims)
        signature = encoding.to_base64url(raw_from_der(self.signers[prepared.uav_id](said)))
        return tx.SubmitProof(session_id=requested.tx_id, evidence=replace(evidence, uav_signature=signature))

    def measured(self, number, now_ms):
        """One of the prepared sets of ranges, as if they had just been measured."""
        evidence = self.evidence[number % len(self.evidence)]
        by_ms = now_ms - evidence.ranges.t_ms[-1]
        return replace(
            evidence,
            ranges=replace(evidence.ranges, t_ms=tuple(t_ms + by_ms for t_ms in evidence.ranges.t_ms)),
            claims=tuple(replace(self.claim, t_ms=claim.t_ms + by_ms) for claim in evidence.claims),
            broadcast=tuple(replace(each, t_ms=each.t_ms + by_ms, **self.here) for each in evidence.broadcast),
        )
