"""The contract where it lives: found by its entry point, on the embedded ledger, over TLS, by the Gateway client."""

from __future__ import annotations

import asyncio
import time

import pytest

from wonderland.proofs import encoding
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.transcript import transcript_of
from wonderland_fabric_gateway.embedded.contracts import load_contract
from wonderland_fabric_gateway.embedded.node import EmbeddedLedger
from wonderland_fabric_gateway.gateway import CommitError, EndorseError, EvaluateError, Gateway
from wonderland_fabric_gateway.signing import raw_from_der

YEAR_MS = 365 * 86_400_000


class Client:
    """Submits and evaluates as any of the identities of a first start."""

    def __init__(self, ledger, channel) -> None:
        connection = ledger.connection
        self.networks = {
            name: Gateway(channel, connection.identity(name), connection.signer(name)).network(connection.channel)
            for name in ("admin", "mirror", "pad_operator", "pad", "fleet_operator", "uav")
        }
        self.chaincode = connection.chaincode

    def contract(self, who):
        return self.networks[who].contract(self.chaincode)

    async def submit(self, who, function, argument=None, /, **fields):
        argument = encoding.encode({**(argument or {}), **fields})
        done = await self.contract(who).submit(function, argument)
        return done, encoding.decode(done.payload)

    async def query(self, who, function, **fields):
        return encoding.decode(await self.contract(who).evaluate(function, encoding.encode(fields)))


class Signer:
    """The drone's ledger key, as it signs in step 6."""

    def __init__(self, connection) -> None:
        self._sign = connection.signer("uav")

    def sign(self, message):
        return raw_from_der(self._sign(message))


@pytest.fixture
async def ledger(tmp_path):
    async with EmbeddedLedger(tmp_path / "ledger", {"pol": load_contract("pol")}) as running:
        yield running


@pytest.fixture
async def client(ledger):
    async with ledger.connection.open_channel() as channel:
        yield Client(ledger, channel)


@pytest.fixture
async def scene(make_scene, client):
    """A commissioned pad with three prekeys and a drone that may land, at today's time, on the real ledger."""
    scene = make_scene()
    now_ms = scene.now_ms = int(time.time() * 1000)
    valid = {"valid_from_ms": now_ms - 60_000, "valid_until_ms": now_ms + YEAR_MS}
    await client.submit("pad_operator", "RegisterPad", scene.pad_argument())
    commissioning = scene.commissioning(**valid)
    await client.submit("pad_operator", "CommissionPad", pad_id="pad-1", commissioning=commissioning)
    prekeys = [{"prekey_id": f"k{index}", "public_key": scene.point(60 + index)} for index in range(3)]
    await client.submit("pad", "PublishPrekeys", pad_id="pad-1", prekeys=prekeys)
    await client.submit("fleet_operator", "RegisterUav", scene.uav_argument("uav-1"))
    maintenance = scene.maintenance(
        uav_id="uav-1", performed_ms=now_ms - 60_000, valid_until_ms=valid["valid_until_ms"]
    )
    await client.submit("fleet_operator", "RecordMaintenance", maintenance)
    await client.submit("admin", "GrantAuthorisation", scene.authorisation(uav_id="uav-1", **valid))
    scene.now_ms = int(time.time() * 1000)
    return scene


async def test_a_proof_from_request_to_landing(ledger, client, scene):
    listening = client.networks["mirror"].chaincode_events("pol", start_block=0)
    done, session = await client.submit("uav", "RequestProof", scene.request_argument("k1"))
    assert session["session_id"] == done.tx_id
    assert session["uav"]["msp_id"] == "FleetMSP"
    identity = ledger.connection.identity("uav")
    assert session["uav"]["certificate_sha256"] == identity.certificate_sha256
    assert session["uav"]["public_key"] == encoding.to_base64url(identity.public_key_bytes)
    pad_certificate = ledger.connection.identity("pad").certificate_sha256
    assert session["pad"] == {"msp_id": "PadMSP", "certificate_sha256": pad_certificate}
    digest = transcript_of(Session.parse(session), ledger.connection.channel).digest()
    assert session["transcript_sha256"] == digest.hex()
    listed = await client.query("uav", "ListPrekeys", pad_id="pad-1")
    assert [key["prekey_id"] for key in listed["prekeys"]] == ["k0", "k2"]

    evidence = scene.evidence(session, signer=Signer(ledger.connection))
    _, verdict = await client.submit("pad", "SubmitProof", session_id=done.tx_id, evidence=evidence)
    assert (verdict["outcome"], verdict["permission"]) == ("verified", "granted"), verdict["reasons"]
    await client.submit("uav", "CompleteInteraction", session_id=done.tx_id, result="done")
    ended = await client.query("mirror", "ReadSession", session_id=done.tx_id)
    assert (ended["state"], ended["end"], ended["ended_by"]) == ("completed", "done", "uav")

    events = []
    async with listening:
        async for event in listening:
            events.append(event)
            if event.name == "InteractionCompleted":
                break
    assert [event.name for event in events][-3:] == ["ProofRequested", "ProofDecided", "InteractionCompleted"]
    payload = encoding.decode(events[-2].payload)
    assert payload["record"] == verdict
    assert (payload["kind"], payload["tx_id"]) == ("ProofDecided", events[-2].tx_id)


async def test_two_requests_at_once_for_one_prekey_open_one_session(client, scene):
    """Both are endorsed on the same state; the ledger's version check makes the key's use single."""
    argument = encoding.encode(scene.request_argument("k1"))
    proposals = [client.contract("uav").propose("RequestProof", argument) for _ in range(2)]
    endorsed = [await proposal.endorse() for proposal in proposals]
    commits = [await transaction.submit() for transaction in endorsed]
    statuses = await asyncio.gather(*(commit.status() for commit in commits))
    assert sorted(status.is_valid for status in statuses) == [False, True]
    (lost,) = [status for status in statuses if not status.is_valid]
    with pytest.raises(CommitError, match="MVCC_READ_CONFLICT"):
        lost.require_valid()
    with pytest.raises(EndorseError, match="PREKEY_USED") as caught:
        await client.submit("uav", "RequestProof", scene.request_argument("k1"))
    assert "chaincode response 409, PREKEY_USED: " in str(caught.value)


async def test_requests_at_once_with_different_prekeys_do_not_conflict(client, scene):
    sessions = await asyncio.gather(
        *(client.submit("uav", "RequestProof", scene.request_argument(f"k{index}")) for index in range(3))
    )
    assert len({session["session_id"] for _, session in sessions}) == 3


async def test_refusals_reach_the_client_with_status_and_text(client, scene):
    for who, function, argument, said in (
        ("mirror", "ReadPad", {"pad_id": "nowhere"}, "chaincode response 404, PAD_UNKNOWN: "),
        ("mirror", "ReadPad", {"pad": "x"}, "chaincode response 400, BAD_ARGUMENT: pad: unknown field"),
        ("mirror", "NoSuch", {}, "chaincode response 404, FUNCTION_UNKNOWN: "),
    ):
        with pytest.raises(EvaluateError) as refused:
            await client.query(who, function, **argument)
        assert said in str(refused.value)
    with pytest.raises(EndorseError) as caught:
        await client.submit("pad", "RetirePad", pad_id="pad-1", reason="x")
    assert "chaincode response 403, ROLE_NOT_ALLOWED: " in str(caught.value)


async def test_an_assets_history_is_kept_by_the_ledger(client):
    asset = {"id": "a", "type": "std_msgs/msg/String", "media_type": "application/json", "value": '{"data": 1.5}'}
    _, created = await client.submit("uav", "CreateAsset", asset)
    await client.submit("uav", "UpdateAsset", id="a", value="2")
    await client.submit("uav", "DeleteAsset", id="a")
    answer = await client.query("mirror", "AssetHistory", id="a")
    assert [change["deleted"] for change in answer["changes"]] == [True, False, False]
    assert answer["changes"][-1]["asset"] == created
    assert answer["more"] is False
