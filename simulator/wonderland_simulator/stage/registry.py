"""What the ledger has to know before a drone can prove anything: pads, drones, policies, papers."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Final

from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.changes import ProposedChange
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.schema import Record
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import EndorseError, Gateway
from wonderland_simulator.scenario import DAY_MS, Behaviour, DroneSpec, PadSite

REGISTRATION: Final = "FIN87astrdge12k8"
PAD_OPERATOR: Final = "skyport-turku"
PATIENCE: Final = 20
PAUSE_S: Final = 0.25
CONFLICT: Final = 409
FLEET_OPERATOR: Final = "aurora-air"


class Registry:
    """Writes to the ledger as the people who may: the authority, a pad operator, a fleet operator."""

    def __init__(self, connection: Connection, channel: object, *, pad_operator: str = PAD_OPERATOR) -> None:
        self._pad_operator = pad_operator

        def contract(name: str):  # type: ignore[no-untyped-def] # noqa: ANN202
            gateway = Gateway(channel, connection.identity(name), connection.signer(name))  # type: ignore[arg-type]
            return gateway.network(connection.channel).contract(connection.chaincode)

        self._contracts = {name: contract(name) for name in ("admin", "inspector", "pad_operator", "fleet_operator")}

    async def pads(
        self,
        pads: Sequence[PadSite],
        now_ms: int,
        *,
        policy: Callable[[PadSite], Policy],
        commissioning: Callable[[PadSite], Commissioning | None] | None = None,
        site_plans: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Register, commission and give a policy to each.

        ``commissioning``: a pad's record, or None where it keeps the one that it has. ``site_plans``: the SHA-256 of a
        pad's, by the pad's id.
        """

        async def one(pad: PadSite) -> None:
            await self._submit(
                "pad_operator",
                "RegisterPad",
                tx.RegisterPad(
                    pad_id=pad.pad_id,
                    name=pad.name,
                    operator_id=self._pad_operator,
                    lat_e7=pad.lat_e7,
                    lon_e7=pad.lon_e7,
                    height_mm=pad.height_mm,
                ),
            )
            survey = commissioning(pad) if commissioning is not None else pad.commissioning(now_ms)
            if survey is not None:
                argument = tx.CommissionPad(pad_id=pad.pad_id, commissioning=survey)
                await self._submit("pad_operator", "CommissionPad", argument)
            if (sha256 := site_plans.get(pad.pad_id)) is not None:
                plan = tx.SetSitePlan(pad_id=pad.pad_id, site_plan_sha256=sha256)
                await self._submit("pad_operator", "SetSitePlan", plan)
            await self._set_policy(pad.pad_id, "*", policy(pad))
            if pad.dock_assurance is not None:
                docking = replace(policy(pad), min_assurance=pad.dock_assurance, witness_pad_id=pad.witness_pad_id)
                await self._set_policy(pad.pad_id, "dock", docking)

        await asyncio.gather(*(one(pad) for pad in pads))

    async def drones(
        self, drones: Sequence[DroneSpec], now_ms: int, *, commitments: Mapping[str, str] = MappingProxyType({})
    ) -> None:
        """Register each, record its maintenance, authorise it for its pad.

        ``commitments``: to their operator's number, by the drone's id; a drone that has none is registered without one.
        """

        async def one(drone: DroneSpec) -> None:
            await self._submit(
                "fleet_operator",
                "RegisterUav",
                tx.RegisterUav(
                    uav_id=drone.uav_id,
                    operator_id=FLEET_OPERATOR,
                    model=drone.model,
                    registration_commitment=commitments.get(drone.uav_id),
                ),
            )
            lapsed = drone.behaviour is Behaviour.MAINTENANCE_LAPSED
            await self._submit(
                "fleet_operator",
                "RecordMaintenance",
                tx.RecordMaintenance(
                    uav_id=drone.uav_id,
                    performed_ms=now_ms - (400 if lapsed else 20) * DAY_MS,
                    valid_until_ms=now_ms + (-35 if lapsed else 345) * DAY_MS,
                    work="Yearly inspection",
                ),
            )
            await self._submit(
                "admin",
                "GrantAuthorisation",
                tx.GrantAuthorisation(
                    authorisation_id="season",
                    uav_id=drone.uav_id,
                    pad_id=drone.pad_id,
                    actions=("land", "takeoff", "dock"),
                    valid_from_ms=now_ms - DAY_MS,
                    valid_until_ms=now_ms + 90 * DAY_MS,
                ),
            )

        await asyncio.gather(*(one(drone) for drone in drones))

    async def _set_policy(self, pad_id: str, action: str, policy: Policy) -> None:
        """By the two people that this takes."""
        proposal = tx.ProposePolicy(pad_id=pad_id, action=action, policy=policy)
        proposed = ProposedChange.decode(await self._submit("admin", "ProposePolicy", proposal))
        approval = tx.ApproveChange(change_id=proposed.change_id, policy=proposed.policy)
        await self._submit("inspector", "ApproveChange", approval)

    async def _submit(self, who: str, function: str, argument: Record) -> bytes:
        """Submit; where one organisation's peer has not yet seen what another has, wait for it.

        What is on the ledger already, from an earlier run of the same world, stays; the answer is empty then.
        """
        for left in reversed(range(PATIENCE)):
            try:
                payload: bytes = (await self._contracts[who].submit_with_retry(function, argument.encode())).payload
            except EndorseError as error:
                answer = error.chaincode_response
                if answer is not None and answer.status == CONFLICT:
                    break
                if not left:
                    raise
                await asyncio.sleep(PAUSE_S)
            else:
                return payload
        return b""
