"""Each role does its own, and nothing else; an organisation looks after its own."""

import asyncio

import pytest
from kit.contract import Scene
from kit.scenario_world import also_with_the_node_client

from wonderland.proofs.records.transactions import ROLES, TRANSACTIONS
from wonderland_fabric_gateway.gateway import EndorseError

pytestmark = pytest.mark.timeout(300)


@also_with_the_node_client
@pytest.mark.parametrize("role", ROLES)
async def test_a_role_is_refused_what_is_not_its_own(people, role):
    """By its certificate, before the argument is even read."""

    async def refused(function):
        with pytest.raises(EndorseError) as raised:
            await people[role].endorsed(function, {"no such field": 0})
        return raised.value.chaincode_response

    for function, transaction in TRANSACTIONS.items():
        response = await refused(function)
        if role in transaction.roles:
            assert response.status != 403, (function, response)
        else:
            assert (response.status, response.message.partition(":")[0]) == (403, "ROLE_NOT_ALLOWED"), function


async def test_one_operators_pads_are_not_the_others(people, site):
    rival = people["pad_operator@Pad2MSP"]
    foreign = "PAD_OF_OTHER_ORGANISATION"
    await rival.is_refused(403, foreign, "UpdatePad", pad_id=site.pad_id, name="x")
    await rival.is_refused(403, foreign, "RetirePad", pad_id=site.pad_id, reason="x")
    commissioning = site.scene().commissioning(valid_from_ms=people.now_ms, valid_until_ms=people.now_ms + 10**9)
    await rival.is_refused(403, foreign, "CommissionPad", pad_id=site.pad_id, commissioning=commissioning)
    renamed = await site.admin.submit("UpdatePad", pad_id=site.pad_id, name="Named by the authority")
    assert renamed["msp_id"] == "PadMSP"


@also_with_the_node_client
async def test_a_pad_and_a_drone_speak_for_themselves(site_of):
    here, there = await asyncio.gather(site_of(), site_of("Pad2MSP"))
    prekeys = [{"prekey_id": "x", "public_key": here.scene().point(99)}]
    await there.pad.is_refused(403, "NOT_THIS_PAD", "PublishPrekeys", pad_id=here.pad_id, prekeys=prekeys)
    session = await here.request()
    session_id = session["session_id"]
    evidence = here.evidence(session)
    await there.pad.is_refused(403, "NOT_THIS_PAD", "SubmitProof", session_id=session_id, evidence=evidence)
    for stranger in (there.pad, there.uav):
        await stranger.is_refused(403, "NOT_YOUR_SESSION", "CancelProof", session_id=session_id, reason="operator")
    await here.admin.submit("CancelProof", session_id=session_id, reason="operator")


async def test_a_drone_that_the_fleet_has_not_registered_cannot_ask(people, site):
    stranger = await people.enrol("uav", f"{site.uav_id}-new")
    await stranger.is_refused(404, "UAV_UNKNOWN", "RequestProof", site.wish())


async def test_a_suspension_is_the_authoritys_to_lift(site):
    uav_id = site.uav_id
    await site.admin.submit("SetUavStatus", uav_id=uav_id, status="suspended", reason="inspection")
    with pytest.raises(EndorseError) as raised:
        await site.fleet.submit("SetUavStatus", uav_id=uav_id, status="active", reason="we disagree")
    assert raised.value.chaincode_response.status == 403
    verdict = await site.judge(await site.request())
    assert verdict["permission"] == "refused"
    proposed = await site.people["inspector"].submit("ProposeReinstatement", uav_id=uav_id, reason="inspected")
    await site.people["inspector"].is_refused(403, "SAME_PERSON", "ApproveChange", Scene.approval(proposed))
    await site.admin.submit("ApproveChange", Scene.approval(proposed))
    verdict = await site.judge(await site.request("k1"))
    assert verdict["permission"] == "granted"
