"""A drone asks to land: what the ledger says when it is honest, when it lies, and when nothing comes of it."""

import time

import pytest
from kit.scenario_world import also_with_the_node_client

from wonderland.proofs.records.sessions import Session
from wonderland.proofs.transcript import transcript_of

pytestmark = pytest.mark.timeout(300)
HERE = (2_000, 1_000, 1_500)
FIFTY_METRES_AWAY = (50_000, 1_000, 1_500)


async def told(people, since, session_id):
    """Names of the events about a session from a block on, until it has ended."""
    names = []
    connection = people.connection
    stream = people["mirror"].network.chaincode_events(connection.chaincode, start_block=since)
    async with stream:
        async for event in stream:
            if session_id.encode() in event.payload or event.tx_id == session_id:
                names.append(event.name)
            if names and names[-1] in {"InteractionCompleted", "ProofCancelled"}:
                break
    return names


@also_with_the_node_client
async def test_an_honest_drone_lands(people, site):
    done, session = await site.uav.submitted("RequestProof", site.wish())
    assert (session["state"], session["session_id"]) == ("requested", done.tx_id)
    parsed = Session.parse(session)
    assert session["transcript_sha256"] == transcript_of(parsed, people.connection.channel).digest().hex()
    assert session["pad"]["certificate_sha256"] == site.pad.identity.certificate_sha256
    await site.mirror.finds_nothing("ReadVerdict", session_id=done.tx_id)

    verdict = await site.judge(session)
    assert (verdict["outcome"], verdict["permission"]) == ("verified", "granted"), verdict["reasons"]
    assert await site.mirror.query("ReadVerdict", session_id=done.tx_id) == verdict

    landed = await site.uav.submit("CompleteInteraction", session_id=done.tx_id, result="done")
    assert (landed["state"], landed["end"], landed["ended_by"]) == ("completed", "done", "uav")
    assert await site.mirror.query("ReadSession", session_id=done.tx_id) == landed
    assert await told(people, done.block_number, done.tx_id) == [
        "ProofRequested",
        "ProofDecided",
        "InteractionCompleted",
    ]


@also_with_the_node_client
async def test_a_liar_is_refuted_and_may_not_land(people, site):
    done, session = await site.uav.submitted("RequestProof", site.wish())
    verdict = await site.judge(session, truth=FIFTY_METRES_AWAY)
    assert (verdict["outcome"], verdict["permission"]) == ("refuted", "refused")
    session_id = done.tx_id
    await site.uav.is_refused(422, "NO_PERMISSION", "CompleteInteraction", session_id=session_id, result="done")
    ended = await site.pad.submit("CancelProof", session_id=session_id, reason="refused")
    assert (ended["state"], ended["ended_by"]) == ("cancelled", "pad")
    assert await told(people, done.block_number, session_id) == ["ProofRequested", "ProofDecided", "ProofCancelled"]


def codes(verdict):
    return {reason["code"] for reason in [*verdict["reasons"], *verdict["signed"]["reasons"]]}


async def test_lies_at_some_moments_are_not_verified_for_the_truth_at_others(site):
    verdict = await site.judge(await site.request(), astray={0, 3, 4, 7})
    assert (verdict["outcome"], verdict["permission"]) == ("inconclusive", "refused")
    assert "claims_torn" in codes(verdict)


async def test_anchors_that_are_silent_now_and_then_prove_nothing(site):
    radio = {"measured_by": "pad", "sts": "provisioned", "attempted_rounds": 40}
    verdict = await site.judge(
        await site.request(), radio=radio, silent=lambda anchor, number: number % 4 == anchor and number % 8 < 6
    )
    assert (verdict["outcome"], verdict["permission"]) == ("inconclusive", "refused")
    assert "rounds_missing" in codes(verdict)


async def test_a_bystander_convicts_nobody(people, site):
    """Somebody broadcasts the drone's serial number 36 m away: it lands where its own broadcast is heard, too."""
    outcomes = []
    for prekey_id, own in (("k0", True), ("k1", False)):
        session = await site.request(prekey_id)
        scene = site.scene()
        places = [(HERE[0] + 36_000, *HERE[1:]), *([HERE] if own else [])]
        heard = [
            {name: claim[name] for name in ("lat_e7", "lon_e7", "t_ms")}
            for claim in (scene.claim(place, t_ms=scene.now_ms + 1_000) for place in places)
        ]
        verdict = await site.judge(session, broadcast=heard)
        assert verdict["broadcast"]["outcome"] == "contradicted"
        assert verdict["signed"]["outcome"] == "verified"
        outcomes.append((verdict["outcome"], verdict["permission"]))
    assert outcomes == [("verified", "granted"), ("inconclusive", "refused")]


async def test_a_drone_without_authorisation_is_ranged_and_denied(site_of):
    site = await site_of(authorised=False)
    verdict = await site.judge(await site.request())
    assert (verdict["outcome"], verdict["permission"]) == ("verified", "refused")
    assert "not_authorised" in {reason["code"] for reason in verdict["reasons"]}


async def test_somebody_elses_signature_proves_nothing(people, site):
    session = await site.request()
    evidence = site.scene().evidence(session, signer=site.pad)
    people.later(2_500)
    verdict = await site.pad.submit("SubmitProof", session_id=session["session_id"], evidence=evidence)
    assert verdict["permission"] == "refused"
    assert verdict["outcome"] != "verified"


@also_with_the_node_client
async def test_a_session_expires_and_is_cancelled(people, site):
    session = await site.request()
    session_id = session["session_id"]
    evidence = site.evidence(session)
    people.later(session["expires_ms"] - people.now_ms)
    await site.pad.is_refused(422, "SESSION_EXPIRED", "SubmitProof", session_id=session_id, evidence=evidence)
    await site.pad.submit("CancelProof", session_id=session_id, reason="timeout")
    text = await site.uav.is_refused(422, "SESSION_CANCELLED", "CancelProof", session_id=session_id, reason="timeout")
    assert "is cancelled; this needs one that is requested" in text


@also_with_the_node_client
async def test_a_prekey_serves_once(site):
    session = await site.request("k1")
    await site.uav.is_refused(409, "PREKEY_USED", "RequestProof", site.wish("k1"))
    await site.uav.is_refused(404, "PREKEY_UNKNOWN", "RequestProof", site.wish("k77"))
    offered = [{"prekey_id": "k1", "public_key": session["pad_key"]}]
    await site.pad.is_refused(409, "PREKEY_USED", "PublishPrekeys", pad_id=site.pad_id, prekeys=offered)
    listed = await site.uav.query("ListPrekeys", pad_id=site.pad_id)
    assert [each["prekey_id"] for each in listed["prekeys"]] == ["k0", "k2"]


async def test_a_claim_of_yesterday_is_refused(people, site):
    wish = site.wish()
    people.later(wish["claim"]["t_ms"] - people.now_ms + 20_000)
    text = await site.uav.is_refused(422, "CLAIM_TOO_OLD", "RequestProof", wish)
    assert "claim a fresh position" in text


async def test_an_active_zone_closes_the_pad_until_it_ends(people, site):
    """The authority's closures: read back, refused by another's hand, and the permission refused for the zone."""
    now_ms = time.time_ns() // 1_000_000
    closed = {"zone_id": "FIN:P1", "actions": ["land"], "from_ms": now_ms - 60_000, "until_ms": now_ms + 3_600_000}
    said = {"pad_id": site.pad_id, "closures": [closed], "valid_until_ms": now_ms + 86_400_000}
    await site.operator.is_refused(403, "ROLE_NOT_ALLOWED", "SetClosures", said)
    stored = await site.admin.submit("SetClosures", said)
    assert await site.mirror.query("ReadClosures", pad_id=site.pad_id) == stored
    verdict = await site.judge(await site.request("k0"))
    assert (verdict["outcome"], verdict["permission"]) == ("verified", "refused")
    assert [each["facts"] for each in verdict["reasons"] if each["code"] == "zone_active"] == [
        {"zone_id": "FIN:P1", "action": "land", "pad_id": site.pad_id}
    ]
    await site.admin.submit("SetClosures", said, closures=[])
    assert (await site.judge(await site.request("k1")))["permission"] == "granted"
