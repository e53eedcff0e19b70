"""A drone asks to land: what the ledger says when it is honest, when it lies, and when nothing comes of it."""

import time

import pytest
from scenario_world import also_with_the_node_client

from wonderland.proofs.records.sessions import Session
from wonderland.proofs.transcript import transcript_of

pytestmark = pytest.mark.timeout(300)
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
    assert [each["text"] for each in verdict["reasons"] if each["code"] == "zone_active"] == [
        f"Zone FIN:P1 forbids the action land at pad {site.pad_id}."
    ]
    await site.admin.submit("SetClosures", said, closures=[])
    assert (await site.judge(await site.request("k1")))["permission"] == "granted"
