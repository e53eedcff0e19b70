"""The contract service under real peers: a whole proof, long ranges and histories, a restart in the middle of work;
and afterwards every transaction of that chain once more in place, as the embedded ledger runs it.
"""

from __future__ import annotations

import asyncio
import os
import signal
import time

import pytest
from kit import contract_peer as peers
from kit.contract import Scene
from kit.every_peer import every_peer

from wonderland.proofs import encoding
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.transcript import transcript_of
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded import rwset as rwsets
from wonderland_fabric_gateway.embedded.contracts import load_contract
from wonderland_fabric_gateway.gateway import CommitError, EndorseError, EvaluateError, Gateway
from wonderland_fabric_gateway.signing import raw_from_der
from wonderland_fabric_gateway.transactions import TransactionType
from wonderland_fabric_network.agreement import load_agreement
from wonderland_fabric_network.network import contract_component

pytestmark = pytest.mark.fabric
YEAR_MS = 365 * 86_400_000


class Client:
    """Submits and evaluates as the identities of connection.json."""

    def __init__(self, connection, channel, everywhere):
        self.connection = connection
        self.everywhere = everywhere
        self.networks = {
            name: Gateway(channel, connection.identity(name), connection.signer(name)).network(connection.channel)
            for name in connection.identities
        }

    def contract(self, who):
        return self.networks[who].contract(self.connection.chaincode)

    async def submit(self, who, function, argument=None, /, **fields):
        argument = encoding.encode({**(argument or {}), **fields})
        async with asyncio.timeout(30):
            while True:
                try:
                    done = await self.contract(who).submit_with_retry(function, argument)
                except EndorseError as error:
                    # On a busy machine peers lose sight of each other for a moment.
                    if "no combination of peers" not in str(error):
                        raise
                    await asyncio.sleep(0.2)
                else:
                    await self.everywhere(done.block_number)
                    return done, encoding.decode(done.payload)

    async def query(self, who, function, **fields):
        found = await self.contract(who).evaluate(function, encoding.encode(fields))
        return encoding.decode(found, max_bytes=8 << 20)


class Signer:
    """The drone's ledger key, as it signs in step 6."""

    def __init__(self, connection):
        self._sign = connection.signer("uav")

    def sign(self, message):
        return raw_from_der(self._sign(message))


@pytest.fixture(scope="module")
def running(fabric, network_class, tmp_path_factory):
    """A network of this module's own: who endorses here is what no other module's test may change."""
    del fabric
    network = network_class.start(tmp_path_factory.mktemp("service") / "net")
    yield network
    network.down()


@pytest.fixture
async def client(running):
    directory = running.network.directory
    own = [
        Connection.load(directory.organisation(each.msp_id).connection_file) for each in running.network.organisations
    ]
    connection = running.connection
    async with every_peer(own) as everywhere, connection.open_channel() as channel:
        yield Client(connection, channel, everywhere)


@pytest.fixture
def ids(client):
    """The registry ids that the certificates of pad and drone carry."""
    return client.connection.identity("pad").pol_id, client.connection.identity("uav").pol_id


async def ensure(client, who, function, argument):
    """Submit, unless an earlier test did."""
    try:
        await client.submit(who, function, argument)
    except EndorseError as error:
        if "chaincode response 409" not in str(error):
            raise


async def prepared(client, ids, prekeys):
    """A commissioned pad with fresh prekeys and a drone that may land, at today's time."""
    pad_id, uav_id = ids
    scene = Scene()
    now_ms = scene.now_ms = int(time.time() * 1000)
    valid = {"valid_from_ms": now_ms - 60_000, "valid_until_ms": now_ms + YEAR_MS}
    await ensure(client, "pad_operator", "RegisterPad", scene.pad_argument(pad_id))
    commissioning = scene.commissioning(**valid)
    await client.submit("pad_operator", "CommissionPad", pad_id=pad_id, commissioning=commissioning)
    offered = [{"prekey_id": each, "public_key": scene.point(60 + index)} for index, each in enumerate(prekeys)]
    await client.submit("pad", "PublishPrekeys", pad_id=pad_id, prekeys=offered)
    await ensure(client, "fleet_operator", "RegisterUav", scene.uav_argument(uav_id))
    maintenance = scene.maintenance(uav_id=uav_id, performed_ms=now_ms - 60_000, valid_until_ms=valid["valid_until_ms"])
    await client.submit("fleet_operator", "RecordMaintenance", maintenance)
    await ensure(client, "admin", "GrantAuthorisation", scene.authorisation(uav_id=uav_id, pad_id=pad_id, **valid))
    scene.now_ms = int(time.time() * 1000)
    return scene


def fresh(name):
    return f"{name}-{os.urandom(4).hex()}"


async def test_a_proof_from_request_to_landing_on_fabric(client, ids):
    prekey = fresh("k")
    scene = await prepared(client, ids, [prekey])
    start = await client.networks["mirror"].height()
    listening = client.networks["mirror"].chaincode_events("pol", start_block=start)
    done, session = await client.submit("uav", "RequestProof", scene.request_argument(prekey, pad_id=ids[0]))
    assert session["session_id"] == done.tx_id
    connection = client.connection
    assert session["uav"]["certificate_sha256"] == connection.identity("uav").certificate_sha256
    digest = transcript_of(Session.parse(session), connection.channel).digest()
    assert session["transcript_sha256"] == digest.hex()

    evidence = scene.evidence(session, signer=Signer(connection))
    _, verdict = await client.submit("pad", "SubmitProof", session_id=done.tx_id, evidence=evidence)
    assert (verdict["outcome"], verdict["permission"]) == ("verified", "granted"), verdict["reasons"]
    await client.submit("uav", "CompleteInteraction", session_id=done.tx_id, result="done")
    ended = await client.query("mirror", "ReadSession", session_id=done.tx_id)
    assert (ended["state"], ended["end"], ended["ended_by"]) == ("completed", "done", "uav")

    events = []
    async with listening, asyncio.timeout(20):
        async for event in listening:
            events.append(event)
            if event.name == "InteractionCompleted":
                break
    assert [event.name for event in events][-3:] == ["ProofRequested", "ProofDecided", "InteractionCompleted"]
    payload = encoding.decode(events[-2].payload)
    assert payload["record"] == verdict
    assert (payload["kind"], payload["tx_id"]) == ("ProofDecided", events[-2].tx_id)


async def test_two_requests_at_once_for_one_prekey_open_one_session_on_fabric(client, ids):
    prekey = fresh("k")
    scene = await prepared(client, ids, [prekey])
    argument = encoding.encode(scene.request_argument(prekey, pad_id=ids[0]))
    proposals = [client.contract("uav").propose("RequestProof", argument) for _ in range(2)]
    endorsed = [await proposal.endorse() for proposal in proposals]
    commits = [await transaction.submit() for transaction in endorsed]
    statuses = await asyncio.gather(*(commit.status() for commit in commits))
    assert sorted(status.is_valid for status in statuses) == [False, True]
    (lost,) = [status for status in statuses if not status.is_valid]
    with pytest.raises(CommitError, match="MVCC_READ_CONFLICT"):
        lost.require_valid()
    with pytest.raises(EndorseError, match="chaincode response 409, PREKEY_USED: "):
        await client.submit("uav", "RequestProof", scene.request_argument(prekey, pad_id=ids[0]))


async def test_a_page_of_a_range_and_a_batch_of_writes(client, ids):
    """Fabric hands out ranges in pages of 100, and takes as many writes at once."""
    names = sorted(fresh("0-page") for _ in range(100))
    scene = await prepared(client, ids, [fresh("k")])
    offered = [{"prekey_id": each, "public_key": scene.point(100 + index)} for index, each in enumerate(names)]
    await client.submit("pad", "PublishPrekeys", pad_id=ids[0], prekeys=offered)
    found = await client.query("mirror", "ListPrekeys", pad_id=ids[0], limit=100)
    assert [each["prekey_id"] for each in found["prekeys"]] == names


async def test_a_history_longer_than_a_page_of_the_peer(client):
    asset = fresh("asset")
    new = {"id": asset, "type": "std_msgs/msg/Int32", "media_type": "application/json", "value": "0"}
    _, created = await client.submit("uav", "CreateAsset", new)
    for number in range(1, 105):
        await client.submit("uav", "UpdateAsset", id=asset, value=str(number))
    await client.submit("uav", "DeleteAsset", id=asset)
    answer = await client.query("mirror", "AssetHistory", id=asset, limit=100)  # and one more, to know of it
    assert answer["more"] is True
    assert [change["deleted"] for change in answer["changes"]] == [True] + [False] * 99
    assert [change["asset"]["value"] for change in answer["changes"][1:]] == [str(n) for n in range(104, 5, -1)]
    assert answer["changes"][1]["asset"]["created_ms"] == created["created_ms"]
    first = await client.query("mirror", "AssetHistory", id=asset, limit=2)
    assert (first["changes"], first["more"]) == (answer["changes"][:2], True)


async def test_refusals_of_the_contract_reach_the_client_as_on_the_embedded_ledger(client):
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


async def test_a_value_that_no_page_of_a_history_could_carry_is_refused(client):
    asset = {"id": fresh("large"), "type": "t/T", "media_type": "text/plain"}
    with pytest.raises(EndorseError, match="chaincode response 400, ASSET_TOO_LARGE: "):
        await client.submit("uav", "CreateAsset", asset | {"value": "é" * 510_000})
    await client.submit("uav", "CreateAsset", asset | {"value": "é" * 490_000})


async def test_a_contract_server_stopped_in_the_middle_loses_nothing_that_was_promised(running, client):
    """Stopped and started again while clients work: each transaction is VALID once or refused, and work goes on."""
    processes = running.network.processes
    agreement = load_agreement(running.network.directory.contract_file)
    server = contract_component("PadMSP", agreement.slot)  # another test may have upgraded this network
    stopped = asyncio.Event()
    done, refused = [], []

    async def work(number):
        count = 0
        while not stopped.is_set():
            count += 1
            asset = {"id": fresh(f"work-{number}-{count}"), "type": "t/T", "media_type": "text/plain", "value": "1"}
            try:
                submitted, _ = await client.submit("uav", "CreateAsset", asset)
                done.append((asset["id"], submitted.tx_id))
            except (EndorseError, CommitError) as error:
                refused.append(str(error))
                await asyncio.sleep(0.05)

    workers = [asyncio.create_task(work(number)) for number in range(8)]
    await asyncio.sleep(1)
    pid = processes.pid(server)
    os.kill(pid, signal.SIGTERM)
    async with asyncio.timeout(15):
        while processes.pid(server) is not None:
            await asyncio.sleep(0.02)
    before = len(done)
    await asyncio.sleep(0.5)
    assert len(done) - before <= len(workers), "without PadMSP nothing can be endorsed"
    await asyncio.to_thread(running.up)
    restarted = len(done)
    async with asyncio.timeout(30):
        while len(done) < restarted + 20:
            await asyncio.sleep(0.1)
    stopped.set()
    await asyncio.gather(*workers)
    assert before > 8
    assert refused
    unclear = [each for each in refused if "PadMSP" not in each and "satisf" not in each]
    assert not unclear, unclear[:3]
    for asset_id, tx_id in (*done[:: max(1, len(done) // 20)], done[-1]):
        answer = await client.query("mirror", "AssetHistory", id=asset_id)
        assert [change["tx_id"] for change in answer["changes"]] == [tx_id]


async def test_every_transaction_of_this_chain_comes_out_the_same_in_place(client):
    """Results, events, reads and writes, byte for byte: what Fabric's peers endorsed and what the embedded ledger would.

    Runs last in this file, so that all transactions above are among them. Of a range that the contract left early the
    peer records what it had fetched ahead, so of ranges only their beginnings are compared.
    """
    contract = load_contract("pol")
    state = peers.State()
    height = await client.networks["mirror"].height()
    seen = {}
    async with client.networks["mirror"].blocks(start_block=0) as blocks, asyncio.timeout(60):
        async for block in blocks:
            for transaction in block.transactions:
                if transaction.type is TransactionType.ENDORSER and transaction.is_valid:
                    replay(contract, state, block.number, transaction, seen)
            if block.number == height - 1:
                break
    assert {"RequestProof", "SubmitProof", "CompleteInteraction", "PublishPrekeys", "CreateAsset"} <= set(seen)
    print(seen)


def replay(contract, state, number, transaction, seen):
    invocation = transaction.invocation
    if invocation.chaincode != "pol":
        return
    (access,) = [each for each in invocation.accesses if each.namespace == "pol"]
    call = Proposed(transaction)
    status, text, payload, event, rwset = peers.in_place(contract, call, state)
    assert (status, text, payload) == (200, "", invocation.response.payload), invocation.function
    found = invocation.event
    assert event == (found and (found.name, found.payload))
    theirs = rwsets.from_accesses([access])
    assert as_bytes(rwset.writes) == as_bytes(theirs.writes), invocation.function
    assert {(read.key, read.version) for read in rwset.reads} == {(read.key, read.version) for read in theirs.reads}
    assert [each.start for each in rwset.ranges] == [each.start for each in theirs.ranges]
    seen[invocation.function] = seen.get(invocation.function, 0) + 1
    for write in access.writes:
        change = peers.types.SimpleNamespace(
            tx_id=transaction.tx_id,
            timestamp_ms=transaction.timestamp_ms,
            value=write.value,
            is_delete=write.is_delete,
        )
        state.past.setdefault(write.key, []).insert(0, change)
        if write.is_delete:
            state.now.pop(write.key, None)
        else:
            state.now[write.key] = write.value, (number, transaction.index)


def as_bytes(writes):
    return rwsets.encode(rwsets.ReadWriteSet(writes=tuple(writes)), "pol")


class Proposed:
    """A transaction of the chain, as `in_place` takes a call."""

    def __init__(self, transaction):
        self.channel = transaction.channel
        self.tx_id = transaction.tx_id
        self.timestamp_ms = transaction.timestamp_ms
        self.creator = transaction.creator.creator
        self.raw_args = list(transaction.invocation.args)
