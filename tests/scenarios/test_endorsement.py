"""Who must sign: the authority and an operator of pads; and for what belongs to a pad, its own operator."""

import pytest
from kit import witnesses
from kit.forgers import endorsed_by_nobody, one_endorsement_more, submitted_changed
from kit.scenario_world import also_with_the_node_client

from wonderland_fabric_gateway.gateway import CommitError

pytestmark = pytest.mark.timeout(300)
NOT_ENOUGH = "ENDORSEMENT_POLICY_FAILURE"


async def not_enough(person, organisations, function, argument=None, /, **fields):
    """Endorsed by these organisations only, the transaction gets into a block and is invalid."""
    with pytest.raises(CommitError) as raised:
        await person.submit(function, argument, endorsed_by=organisations, **fields)
    assert raised.value.code_name == NOT_ENOUGH
    await person.people.everywhere(raised.value.block_number)
    return raised.value


@also_with_the_node_client
@pytest.mark.parametrize(
    ("organisations", "enough"),
    [
        ("AuthorityMSP", False),
        ("PadMSP", False),
        ("PadMSP Pad2MSP", False),
        ("AuthorityMSP PadMSP", True),
        ("AuthorityMSP Pad2MSP", True),
    ],
)
async def test_a_transaction_needs_the_authority_and_an_operator_of_pads(people, tag, organisations, enough):
    asset = {"id": tag, "type": "std_msgs/msg/String", "media_type": "text/plain", "value": "1"}
    uav, organisations = people["uav"], organisations.split()
    if enough:
        await uav.submit("CreateAsset", asset, endorsed_by=organisations)
        assert (await uav.query("ReadAsset", id=tag))["value"] == "1"
    else:
        await not_enough(uav, organisations, "CreateAsset", asset)
        await uav.finds_nothing("ReadAsset", id=tag)


@also_with_the_node_client
async def test_the_gateway_finds_out_itself_who_must_sign(people, site_of):
    """Nobody names organisations; the second operator's pad is signed for by the second operator."""
    site = await site_of("Pad2MSP")
    done, _ = await site.operator.submitted("UpdatePad", pad_id=site.pad_id, name="East roof")
    assert {"AuthorityMSP", "Pad2MSP"} <= await people.endorsers(done)
    done, session = await site.uav.submitted("RequestProof", site.wish())
    assert {"AuthorityMSP", "Pad2MSP"} <= await people.endorsers(done)
    evidence = site.evidence(session)
    done, verdict = await site.pad.submitted("SubmitProof", session_id=session["session_id"], evidence=evidence)
    assert {"AuthorityMSP", "Pad2MSP"} <= await people.endorsers(done)
    assert verdict["permission"] == "granted"


@also_with_the_node_client
async def test_the_other_operators_signature_does_not_count_for_a_pad(site_of):
    """A session of one operator's pad from its request to its end: the authority and the other operator cannot."""
    site = await site_of("Pad2MSP")
    without_it = ["AuthorityMSP", "PadMSP"]
    await not_enough(site.operator, without_it, "UpdatePad", pad_id=site.pad_id, name="Mine now")
    await not_enough(site.admin, without_it, "RetirePad", pad_id=site.pad_id, reason="unwanted")
    await not_enough(site.uav, without_it, "RequestProof", site.wish())

    session = await site.uav.submit("RequestProof", site.wish(), endorsed_by=["AuthorityMSP", "Pad2MSP"])
    its = {"session_id": session["session_id"]}
    evidence = site.evidence(session)
    await not_enough(site.pad, without_it, "SubmitProof", its, evidence=evidence)
    await not_enough(site.admin, without_it, "CancelProof", its, reason="operator")
    assert (await site.mirror.query("ReadSession", its))["state"] == "requested"
    await site.mirror.finds_nothing("ReadVerdict", **its)

    await site.pad.submit("SubmitProof", its, evidence=evidence, endorsed_by=["AuthorityMSP", "Pad2MSP"])
    await not_enough(site.uav, without_it, "CompleteInteraction", its, result="done")
    await site.uav.submit("CompleteInteraction", its, result="done")
    pad = await site.mirror.query("ReadPad", pad_id=site.pad_id)
    assert (pad["name"], pad["status"]) == ("Roof", "commissioned")


@also_with_the_node_client
async def test_a_witness_brings_its_own_organisation(people, site_of):
    """The second operator's pad watches the first operator's: what either brings needs its own organisation."""

    def clocks(anchors):
        return {"timestamp_sigma_mm": 30, "anchors": witnesses.anchors(anchors)}

    site = await site_of(survey=clocks(witnesses.PAD_ANCHORS))
    watch = await site_of("Pad2MSP", survey=clocks(witnesses.WITNESS_ANCHORS))
    policy = {"min_assurance": 4, "witness_pad_id": watch.pad_id}
    await site.set_policy(policy, "land")
    wish = {**site.wish(), "witness_prekey_id": "k0"}
    for one_of_them in (["AuthorityMSP", "PadMSP"], ["AuthorityMSP", "Pad2MSP"]):
        await not_enough(site.uav, one_of_them, "RequestProof", wish)
    done, session = await site.uav.submitted("RequestProof", wish)
    assert await people.endorsers(done) == {"AuthorityMSP", "PadMSP", "Pad2MSP"}

    its, scene = {"session_id": session["session_id"]}, site.scene()
    seen = {
        "radio": {"measured_by": "pad", "sts": "provisioned"},
        "time_stamps": witnesses.stamps(scene, witnesses.WITNESS_ANCHORS, bound_by="key"),
    }
    evidence = site.evidence(session, time_stamps=witnesses.stamps(scene, witnesses.PAD_ANCHORS))
    await site.pad.is_refused(403, "NOT_THIS_PAD", "WitnessProof", its, **seen)
    testimony = await watch.pad.submit("WitnessProof", its, **seen)
    assert await site.mirror.query("ReadTestimony", its) == testimony
    verdict = await site.pad.submit("SubmitProof", its, evidence=evidence)
    assert (verdict["permission"], verdict["assurance"]) == ("granted", 4), verdict["reasons"]
    assert verdict["witness"]["pad_id"] == watch.pad_id


@also_with_the_node_client
async def test_two_verdicts_at_once_leave_one(people, site):
    """The second comes to a key that the first has just made: not its endorsers to count on, or not its version."""
    session = await site.request()
    fields = {"session_id": session["session_id"], "evidence": site.evidence(session)}
    outcomes = await people.outcomes([await site.pad.endorsed("SubmitProof", fields) for _ in range(2)])
    outcomes.remove("VALID")
    assert outcomes[0] in {NOT_ENOUGH, "MVCC_READ_CONFLICT"}  # in the same block, or in the next
    await site.pad.is_refused(422, "SESSION_DECIDED", "SubmitProof", fields)


@pytest.mark.parametrize("more", [endorsed_by_nobody, one_endorsement_more], ids=lambda each: each.__name__)
async def test_an_endorsement_that_holds_for_nobody_counts_for_nothing_and_harms_nobody(people, tag, more):
    """Its sender may add one: the transaction is as valid as without it, and everybody can read it."""
    asset = {"id": tag, "type": "std_msgs/msg/String", "media_type": "text/plain", "value": "1"}
    status, _ = await submitted_changed(people["uav"], [more], "CreateAsset", asset)
    assert status.code_name == "VALID"
    assert {"AuthorityMSP"} < await people.endorsers(status)
