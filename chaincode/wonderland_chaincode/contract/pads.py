"""Landing pads: registration, survey, retirement, and the one-time keys that they offer."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from wonderland.proofs import encoding
from wonderland.proofs.records import keys
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.pads import Commissioning, Pad, Prekey
from wonderland_chaincode.contract import access, survey
from wonderland_chaincode.contract.call import Answer, Call, stored
from wonderland_chaincode.contract.errors import bad_input, conflict, not_there, refused
from wonderland_chaincode.contract.signatures import is_point

RETIRED: Final = "retired"


async def require(call: Call, pad_id: str) -> Pad:
    """The pad, or ContractError (404)."""
    pad = await call.find_record(keys.composite(keys.PAD, pad_id), Pad)
    if pad is None:
        raise not_there("PAD_UNKNOWN", f"there is no pad {pad_id}; RegisterPad makes one known")
    return pad


async def require_in_service(call: Call, pad_id: str) -> Pad:
    """The pad, not retired; else ContractError (404, 422)."""
    pad = await require(call, pad_id)
    if pad.status == RETIRED:
        raise refused("PAD_RETIRED", f"pad {pad_id} is retired for good; register another identifier")
    return pad


def commissioned(pad: Pad, now_ms: int) -> tuple[Commissioning, str]:
    """The survey on which a verdict of this moment can stand, and its digest."""
    if pad.commissioning is None or pad.commissioning_sha256 is None:
        raise refused("PAD_NOT_COMMISSIONED", f"pad {pad.pad_id} has not been surveyed; CommissionPad comes first")
    if not pad.commissioning.valid_from_ms <= now_ms < pad.commissioning.valid_until_ms:
        raise refused(
            "COMMISSIONING_NOT_VALID", f"the commissioning of pad {pad.pad_id} is not valid now; survey it again"
        )
    return pad.commissioning, pad.commissioning_sha256


async def register(call: Call, argument: tx.RegisterPad) -> Answer:
    """RegisterPad."""
    key = keys.composite(keys.PAD, argument.pad_id)
    if await call.stub.get(key) is not None:
        raise conflict("PAD_EXISTS", f"pad {argument.pad_id} is registered already; UpdatePad changes it")
    pad = Pad(
        pad_id=argument.pad_id,
        name=argument.name,
        operator_id=argument.operator_id,
        msp_id=call.who.msp_id,
        status="registered",
        lat_e7=argument.lat_e7,
        lon_e7=argument.lon_e7,
        height_mm=argument.height_mm,
        registered_ms=call.now_ms,
        updated_ms=call.now_ms,
        note=argument.note,
    )
    await call.store_new(key, pad, pad.msp_id)
    return Answer.of(pad)


async def update(call: Call, argument: tx.UpdatePad) -> Answer:
    """UpdatePad."""
    if argument.name is None and argument.operator_id is None and argument.note is None:
        raise bad_input("NOTHING_TO_CHANGE", "give at least one of name, operator_id and note")
    pad = await _owned(call, argument.pad_id)
    return await _changed(
        call,
        replace(
            pad,
            name=pad.name if argument.name is None else argument.name,
            operator_id=pad.operator_id if argument.operator_id is None else argument.operator_id,
            note=pad.note if argument.note is None else argument.note,
        ),
    )


async def retire(call: Call, argument: tx.RetirePad) -> Answer:
    """RetirePad."""
    pad = await _owned(call, argument.pad_id)
    return await _changed(call, replace(pad, status=RETIRED, note=argument.reason))


async def commission(call: Call, argument: tx.CommissionPad) -> Answer:
    """CommissionPad: survey and calibration, from now on the ground of the pad's verdicts."""
    pad = await _owned(call, argument.pad_id)
    found = argument.commissioning
    if found.valid_until_ms <= call.now_ms:
        raise refused("COMMISSIONING_NOT_VALID", "the validity of this commissioning is over; survey the pad again")
    survey.check(found)
    return await _changed(
        call,
        replace(
            pad,
            status="commissioned",
            lat_e7=found.frame.lat_e7,
            lon_e7=found.frame.lon_e7,
            height_mm=found.frame.height_mm,
            commissioning=found,
            commissioning_sha256=encoding.digest(found.to_json()).hex(),
        ),
    )


async def set_site_plan(call: Call, argument: tx.SetSitePlan) -> Answer:
    """SetSitePlan: sessions requested from now on name it. The file itself is no ledger's business, its hash is."""
    pad = await _owned(call, argument.pad_id)
    if pad.site_plan_sha256 == argument.site_plan_sha256:
        raise conflict("SITE_PLAN_UNCHANGED", f"pad {pad.pad_id} has this site plan already")
    return await _changed(call, replace(pad, site_plan_sha256=argument.site_plan_sha256))


async def publish_prekeys(call: Call, argument: tx.PublishPrekeys) -> Answer:
    """PublishPrekeys. An identifier serves once: neither a waiting nor a used one can be published again."""
    pad = await require_in_service(call, argument.pad_id)
    access.require_pad_itself(call.who, pad.pad_id, pad.msp_id)
    for what in ("prekey_id", "public_key"):
        if len({getattr(offered, what) for offered in argument.prekeys}) != len(argument.prekeys):
            raise bad_input("PREKEY_TWICE", f"prekeys: two have the same {what}; each key serves one session")
    for index, offered in enumerate(argument.prekeys):
        if not is_point(encoding.from_base64url(offered.public_key)):
            raise bad_input("KEY_NOT_ON_CURVE", f"prekeys[{index}].public_key: no point of P-256")
    waiting, used = (
        [keys.composite(kind, pad.pad_id, offered.prekey_id) for offered in argument.prekeys]
        for kind in (keys.PREKEY, keys.USED_PREKEY)
    )
    found = await call.stub.get_many([*waiting, *used])
    for index, offered in enumerate(argument.prekeys):
        if found[index] is not None:
            raise conflict("PREKEY_EXISTS", f"prekeys[{index}]: {offered.prekey_id} is published already")
        if found[len(waiting) + index] is not None:
            raise conflict("PREKEY_USED", f"prekeys[{index}]: {offered.prekey_id} was used; make a new key")
        prekey = Prekey(
            pad_id=pad.pad_id,
            prekey_id=offered.prekey_id,
            public_key=offered.public_key,
            msp_id=call.who.msp_id,
            certificate_sha256=call.who.certificate_sha256,
            published_ms=call.now_ms,
        )
        await call.store_new(waiting[index], prekey, pad.msp_id)
    document = {"pad_id": pad.pad_id, "published": len(argument.prekeys)}
    return Answer(document, document)


async def read(call: Call, argument: tx.PadById) -> Answer:
    """ReadPad."""
    return Answer((await require(call, argument.pad_id)).to_json())


async def list_prekeys(call: Call, argument: tx.PrekeysOf) -> Answer:
    """ListPrekeys: unused ones, as many as asked for."""
    await require(call, argument.pad_id)
    found: list[dict[str, object]] = []
    start, end = keys.prefix_range(keys.PREKEY, argument.pad_id)
    async for _, data in call.stub.range(start, end):
        found.append(stored(data, Prekey).to_json())
        if len(found) >= argument.limit:
            break
    return Answer({"prekeys": found})


async def _owned(call: Call, pad_id: str) -> Pad:
    """A pad in service that the creator may change."""
    pad = await require(call, pad_id)
    access.require_pad_owner(call.who, pad)
    return await require_in_service(call, pad_id) if pad.status == RETIRED else pad


async def _changed(call: Call, pad: Pad) -> Answer:
    pad = replace(pad, updated_ms=call.now_ms)
    await call.store(keys.composite(keys.PAD, pad.pad_id), pad)
    return Answer.of(pad)
