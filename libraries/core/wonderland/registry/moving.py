"""The registry of one ledger registered anew on another: what is to be done, and whose it is to do. Pure.

Nothing is copied behind the contract's back: each record becomes the transactions that make it, signed by whoever may.
What happened (sessions, verdicts, who approved what) stays on the former ledger, which is kept.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.changes import OPEN
from wonderland.proofs.records.pads import Pad
from wonderland.proofs.records.schema import Record
from wonderland.proofs.records.uavs import Uav
from wonderland.registry.book import Book
from wonderland.registry.changes import DIFFERS, NEW, THERE, Change

_REGISTER, _REST, _PERMIT = range(3)
_RETIRED: Final = "retired"
_CALIBRATIONS: Final = "calibrations of drones, which rest on sessions of the former ledger: calibrate anew"


@dataclass(frozen=True)
class Person:
    """Who moves: a role of an organisation."""

    msp_id: str
    role: str


@dataclass(frozen=True)
class Plan:
    """What one person can do, in stages that follow each other; what others have to do; and what nobody can."""

    stages: tuple[tuple[Change, ...], ...]
    left: Mapping[str, int]
    """How many, by who may: ``pad_operator of PadMSP``."""
    first: tuple[str, ...]
    """What has to hold before authorisations are granted; they wait for it. Empty: they are among the stages."""
    lost: Mapping[str, int]
    """How many, by what they are and why they are not moved."""

    @property
    def to_do(self) -> int:
        """How many transactions are to be submitted."""
        return sum(each.state == NEW for stage in self.stages for each in stage)


@dataclass(frozen=True)
class _Step:
    stage: int
    id: str
    argument: Record
    there: bool
    owner: str | None = None
    """The organisation whose it is, and stays; None where any will do."""
    why: str = ""
    """Why not, where the other ledger has another one."""
    limits: bool = False
    """Whether it keeps drones from what they may do otherwise."""
    roles: tuple[str, ...] = ()
    """Who may; whoever may send such a transaction, where empty."""


def planned(source: Book, target: Book, who: Person, now_ms: int) -> Plan:
    """What `who` has to do so that `target` has what holds on `source`.

    Nothing may be permitted on the new ledger that was not on the former one: authorisations come last, once all
    policies, closures and suspensions are in force there.
    """
    steps = list(_steps(source, target, now_ms))
    first = tuple(each.id for each in steps if each.limits and not each.there)
    stages: tuple[list[Change], ...] = ([], [], [])
    left: dict[str, int] = {}
    for step in steps:
        roles = step.roles or tx.TRANSACTIONS[type(step.argument).__name__].roles
        if step.there or step.why:
            state = DIFFERS if step.why else THERE
            stages[step.stage].append(Change(line=0, id=step.id, argument=step.argument, state=state, why=step.why))
        elif step.stage == _PERMIT and first:
            continue
        elif who.role in roles and step.owner in {None, who.msp_id}:
            stages[step.stage].append(Change(line=0, id=step.id, argument=step.argument))
        else:
            name = " or ".join(roles) + (f" of {step.owner}" if step.owner else "")
            left[name] = left.get(name, 0) + 1
    waiting = any(step.stage == _PERMIT and not step.there for step in steps)
    return Plan(tuple(tuple(each) for each in stages), left, first if waiting else (), _lost(source))


def _steps(source: Book, target: Book, now_ms: int) -> Iterator[_Step]:
    for pad in source.pads.values():
        if pad.status != _RETIRED:
            yield from _pad(pad, target.pads.get(pad.pad_id))
    for drone in source.drones.values():
        if drone.status != _RETIRED:
            yield from _drone(drone, target.drones.get(drone.uav_id))
    for closures in source.closures.values():
        if closures.valid_until_ms > now_ms and closures.closures:
            argument = _argument(tx.SetClosures, closures.to_json())
            now = target.closures.get(closures.pad_id)
            same = now is not None and _argument(tx.SetClosures, now.to_json()) == argument
            yield _Step(_REST, f"closures of {closures.pad_id}", argument, same, limits=True)
    for (pad_id, action), change in source.policies.items():
        assert change.policy is not None
        in_force = target.policies.get((pad_id, action))
        there = in_force is not None and in_force.policy == change.policy
        name = f"policy of {pad_id} for {action}"
        argument = tx.ProposePolicy.parse(change.policy.to_json())
        proposed = any(each.state == OPEN and each.policy == change.policy for each in target.proposals.values())
        why = "was proposed; a second person has to approve it" if proposed and not there else ""
        yield _Step(_REST, name, argument, there, why=why, limits=True)
    for (uav_id, authorisation_id), granted in source.authorisations.items():
        whose = source.drones.get(uav_id)
        if granted.revoked or granted.valid_until_ms <= now_ms or whose is None or whose.status == _RETIRED:
            continue
        known = target.authorisations.get((uav_id, authorisation_id))
        yield _registered(_PERMIT, tx.GrantAuthorisation, f"{uav_id}/{authorisation_id}", granted, known)


def _pad(pad: Pad, there: Pad | None) -> Iterator[_Step]:
    yield _registered(_REGISTER, tx.RegisterPad, pad.pad_id, pad, there, pad.msp_id)
    if pad.commissioning is not None:
        argument = tx.CommissionPad(pad_id=pad.pad_id, commissioning=pad.commissioning)
        same = there is not None and there.commissioning == pad.commissioning
        yield _Step(_REST, f"commissioning of {pad.pad_id}", argument, same, pad.msp_id)
    if pad.site_plan_sha256 is not None:
        plan = tx.SetSitePlan(pad_id=pad.pad_id, site_plan_sha256=pad.site_plan_sha256)
        same = there is not None and there.site_plan_sha256 == pad.site_plan_sha256
        yield _Step(_REST, f"site plan of {pad.pad_id}", plan, same, pad.msp_id)


def _drone(drone: Uav, there: Uav | None) -> Iterator[_Step]:
    yield _registered(_REGISTER, tx.RegisterUav, drone.uav_id, drone, there, drone.msp_id)
    if drone.maintenance is not None:
        argument = _argument(tx.RecordMaintenance, {**drone.maintenance.to_json(), "uav_id": drone.uav_id})
        now = None if there is None else there.maintenance
        same = now is not None and argument == _argument(
            tx.RecordMaintenance, {**now.to_json(), "uav_id": drone.uav_id}
        )
        yield _Step(_REST, f"maintenance of {drone.uav_id}", argument, same, drone.msp_id)
    if drone.status == "suspended":
        reason = drone.status_reason or "suspended on the former ledger"
        suspend = tx.SetUavStatus(uav_id=drone.uav_id, status="suspended", reason=reason)
        same = there is not None and there.status == "suspended"
        name = f"suspension of {drone.uav_id}"
        yield _Step(_REST, name, suspend, same, limits=True, roles=(tx.ADMIN, tx.INSPECTOR))


def _registered(
    stage: int, kind: type[Record], name: str, record: Record, there: Record | None, owner: str | None = None
) -> _Step:
    """The transaction whose argument a record has, beside what the other ledger has under the same id."""
    argument = _argument(kind, record.to_json())
    if there is None:
        return _Step(stage, name, argument, there=False, owner=owner)
    has = there.to_json()
    if has.get("status") == _RETIRED or has.get("revoked"):
        return _Step(stage, name, argument, there=False, why="is retired or revoked there")
    told = argument.to_json() | ({"msp_id": owner} if owner else {})
    other = [each for each, value in told.items() if has.get(each) != value]
    return _Step(stage, name, argument, there=not other, why=f"is another there: {', '.join(other)}" if other else "")


def _argument(kind: type[Record], document: Mapping[str, Any]) -> Record:
    wanted = kind.json_schema()["properties"]
    return kind.parse({name: value for name, value in document.items() if name in wanted})


def _lost(source: Book) -> dict[str, int]:
    number = sum(len(each.calibrations or ()) for each in source.drones.values() if each.status != _RETIRED)
    return {_CALIBRATIONS: number} if number else {}
