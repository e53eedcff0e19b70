"""The same signed proposals on Fabric and on the embedded ledger: the same answers, events and write sets, byte by byte.

The embedded ledger here is the twin of the Fabric network: its channel trusts the same CAs, the same peers sign, the
same contract runs, and it is brought to the same height, so that each block has the same number on both. Whatever is
submitted to Fabric goes to the twin, too, with the same nonce, creator and time.

One thing is left out of the comparison, and asserted to be no more than this: on Fabric each transaction also reads the
contract's definition (the sequence number in the namespace ``_lifecycle``), and the embedded ledger has no life cycle.
"""

import contextlib
import dataclasses
import os
import random
import time

import pytest
from fabric_protos.common import common_pb2
from fabric_protos.gateway import gateway_pb2
from fabric_protos.ledger.rwset import rwset_pb2
from fabric_protos.ledger.rwset.kvrwset import kv_rwset_pb2
from fabric_protos.peer import proposal_pb2, proposal_response_pb2, transaction_pb2
from kit.scenario_world import People, Person, Site, people_at

from wonderland.proofs import encoding
from wonderland_fabric_gateway.blocks import parse_block
from wonderland_fabric_gateway.channel_groups import OrganisationDescription
from wonderland_fabric_gateway.commit_hash import commit_hash_of, expected_commit_hash
from wonderland_fabric_gateway.connection import GatewayAddress
from wonderland_fabric_gateway.embedded import organisations as orgs
from wonderland_fabric_gateway.embedded.chain import Chain, ChainSettings, initialise
from wonderland_fabric_gateway.embedded.committer import Candidate
from wonderland_fabric_gateway.embedded.config_update import ConfigSigners
from wonderland_fabric_gateway.embedded.contracts import load_contract
from wonderland_fabric_gateway.embedded.genesis import ChannelDescription, genesis_block
from wonderland_fabric_gateway.embedded.orderer import BatchLimits
from wonderland_fabric_gateway.embedded.server import LedgerServer, TlsFiles
from wonderland_fabric_gateway.gateway import EndorseError, Gateway
from wonderland_fabric_gateway.transactions import ValidationCode
from wonderland_fabric_network.certificates import signing_identity

pytestmark = [
    pytest.mark.fabric,
    pytest.mark.timeout(300),
    pytest.mark.parametrize("ledger", ["fabric"], indirect=True),
]
TEXT = {"type": "std_msgs/msg/String", "media_type": "text/plain"}


# --- the twin


@contextlib.asynccontextmanager
async def twin_of(network, path, height):
    """An embedded ledger with Fabric's organisations and peers, of that height and with nothing in its state."""

    def organisation(msp_id):
        files = network.directory.organisation(msp_id)
        return OrganisationDescription(msp_id, files.root.read_bytes(), files.tls_root.read_bytes())

    def peer(msp_id):
        return network.node(network.first_peer(msp_id))

    description = ChannelDescription(
        channel=network.channel,
        applications=tuple(organisation(each.msp_id) for each in network.organisations),
        orderer=organisation("OrdererMSP"),
        endorsing=orgs.endorsing(("Pad2MSP",)),
        batch_ms=1,
        batch_count=500,
    )
    initialise(path, lambda: genesis_block(description, int(time.time()), os.urandom(24)))
    orderer = signing_identity("OrdererMSP", network.node(network.orderers[0]).identity)
    settings = ChainSettings(
        channel=network.channel,
        signers=ConfigSigners({}, orderer),
        limits=BatchLimits(time_ms=1),
        clock=lambda: time.time_ns() // 1_000_000,
        random=os.urandom,
    )
    peers = [signing_identity(msp_id, peer(msp_id).identity) for each in description.endorsing for msp_id in each]
    tls = peer("AuthorityMSP").tls
    async with Chain(path, settings) as chain:
        for number in range(1, height):
            invalid = int(ValidationCode.INVALID_OTHER_REASON)
            chain.submit(Candidate(f"filler {number}", b"filler", b"", 0, invalid, 0))
            await chain.wait_for_block(number)
        server = LedgerServer(
            chain,
            {network.description.contract.name: load_contract("pol")},
            peers,
            TlsFiles(tls.certificate.read_bytes(), tls.key.read_bytes()),
        )
        address = await server.start("127.0.0.1:0")
        try:
            yield chain, GatewayAddress(address, network.directory.organisation("AuthorityMSP").tls_root, "localhost")
        finally:
            await chain.close()
            await server.stop()


# --- what is compared


def opened(transaction):
    """(what must be equal as it stands, the endorsers' common response) of a prepared transaction."""
    prepared = gateway_pb2.PreparedTransaction.FromString(transaction.to_bytes())
    return opened_envelope(prepared.envelope)


def opened_envelope(envelope):
    payload = common_pb2.Payload.FromString(envelope.payload)
    (action,) = transaction_pb2.Transaction.FromString(payload.data).actions
    content = transaction_pb2.ChaincodeActionPayload.FromString(action.payload)
    fixed = payload.header.SerializeToString(), action.header, content.chaincode_proposal_payload
    return fixed, content.action.proposal_response_payload


def without_definition(response_payload):
    """Fabric's response without the reading of the contract's definition, which must be there, and be only that."""
    response = proposal_response_pb2.ProposalResponsePayload.FromString(response_payload)
    action = proposal_pb2.ChaincodeAction.FromString(response.extension)
    results = rwset_pb2.TxReadWriteSet.FromString(action.results)
    lifecycle, *others = results.ns_rwset
    assert lifecycle.namespace == "_lifecycle"
    its = kv_rwset_pb2.KVRWSet.FromString(lifecycle.rwset)
    assert [each.key for each in its.reads] == ["namespaces/fields/pol/Sequence"]
    assert [len(each) for each in (its.writes, its.metadata_writes, its.range_queries_info)] == [0, 0, 0]
    assert not lifecycle.collection_hashed_rwset
    action.results = rwset_pb2.TxReadWriteSet(data_model=results.data_model, ns_rwset=others).SerializeToString()
    response.extension = action.SerializeToString()
    return response.SerializeToString()


def require_equal(fabric, twin):
    (fixed, response), (twin_fixed, twin_response) = fabric, twin
    assert twin_fixed == fixed
    expected = without_definition(response)
    if twin_response != expected:  # shown in full only when they differ
        assert readable(twin_response) == readable(expected)
        assert twin_response == expected


def readable(response_payload):
    response = proposal_response_pb2.ProposalResponsePayload.FromString(response_payload)
    action = proposal_pb2.ChaincodeAction.FromString(response.extension)
    sets = [
        (each.namespace, str(kv_rwset_pb2.KVRWSet.FromString(each.rwset)))
        for each in rwset_pb2.TxReadWriteSet.FromString(action.results).ns_rwset
    ]
    return response.proposal_hash.hex(), sets, action.events, str(action.response), str(action.chaincode_id)


class Pair:
    """A transaction that is endorsed on both."""

    def __init__(self, fabric, twin):
        self.both = fabric, twin
        self.tx_id = fabric.tx_id

    async def commit(self):
        """Submit it to both: its status on Fabric, seen to be the same on the twin."""
        statuses = [await (await each.submit()).status() for each in self.both]
        assert statuses[0] == statuses[1]
        return statuses[0]


class TwinPerson(Person):
    """Whatever they submit goes to both ledgers, with one signature."""

    def __init__(self, people, name):
        super().__init__(people, name)
        self._twin = Gateway(people.twin_channel, self.identity, self._sign)

    async def endorsed(self, function, argument=None, /, *, endorsed_by=(), **fields):
        text = encoding.encode({**(argument or {}), **fields})
        proposal = self.contract.propose(function, text, endorsing_organizations=endorsed_by)
        data = proposal.signed(self._sign(proposal.message)).to_bytes()
        results = []
        for gateway in (self.gateway, self._twin):
            try:
                results.append(await gateway.new_proposal(data).endorse())
            except EndorseError as error:
                results.append(error)
        fabric, twin = results
        if isinstance(fabric, EndorseError):
            assert twin.chaincode_response == fabric.chaincode_response
            assert (twin.status_code, twin.message) == (fabric.status_code, fabric.message)
            self.people.refused += 1
            raise fabric
        assert not isinstance(twin, EndorseError), twin
        require_equal(opened(fabric), opened(twin))
        assert fabric.payload == twin.payload
        return Pair(fabric, twin)

    async def submitted(self, function, argument=None, /, *, endorsed_by=(), **fields):
        pair = await self.endorsed(function, argument, endorsed_by=endorsed_by, **fields)
        status = await pair.commit()
        await self.people.everywhere(status.block_number)
        status.require_valid()
        self.people.committed += 1
        return status, encoding.decode(pair.both[0].payload)

    async def query(self, function, argument=None, /, **fields):
        answer = await super().query(function, argument, **fields)
        text = encoding.encode({**(argument or {}), **fields})
        twin = self._twin.network(self.people.connection.channel).contract(self.people.connection.chaincode)
        assert encoding.decode(await twin.evaluate(function, text), max_bytes=8 << 20) == answer
        return answer


class TwinPeople(People):
    person = TwinPerson
    twin_channel = None
    committed = refused = 0


@pytest.fixture
async def people(ledger, tmp_path):
    """They act on Fabric and on its twin."""
    async with people_at(ledger, TwinPeople) as people:
        twin = twin_of(ledger.network, tmp_path / "twin.sqlite3", await _height(people))
        async with twin as (chain, address):
            connection = dataclasses.replace(people.connection, gateway=address, others=(), client_tls=None)
            async with connection.open_channel() as channel:
                people.twin_channel = channel
                people.twin = chain
                yield people


async def _height(people):
    connection = people.connection
    gateway = Gateway(people.channel, connection.identity("mirror"), connection.signer("mirror"))
    return await gateway.network(connection.channel).height()


# --- the scenarios


async def test_pads_drones_and_proofs_are_the_same_on_both(people, tag):
    """All that the contract can do, honest, lying and refused."""
    site = await Site(people, f"{tag}-padmsp", "PadMSP").ready()
    other = await Site(people, f"{tag}-pad2msp", "Pad2MSP").ready()
    for each in (site, other):
        session = await each.request()
        verdict = await each.judge(session)
        assert verdict["permission"] == "granted"
        await each.uav.submit("CompleteInteraction", session_id=session["session_id"], result="done")
    lied = await site.request("k1")
    verdict = await site.judge(lied, truth=(50_000, 1_000, 1_500))
    assert verdict["outcome"] == "refuted"
    await site.pad.submit("CancelProof", session_id=lied["session_id"], reason="refused")
    await site.uav.is_refused(409, "PREKEY_USED", "RequestProof", site.wish("k1"))
    await other.pad.is_refused(403, "NOT_YOUR_SESSION", "CancelProof", session_id=lied["session_id"], reason="refused")
    await site.operator.is_refused(403, "PAD_OF_OTHER_ORGANISATION", "UpdatePad", pad_id=other.pad_id, name="x")
    await site.set_policy({"buffer_mm": 2000})
    await site.operator.submit("UpdatePad", pad_id=site.pad_id, note="Mind the crane")
    later = time.time_ns() // 1_000_000 + 3_600_000
    closed = {"zone_id": "FIN:P1", "actions": ["land"], "from_ms": 0, "until_ms": later}
    await site.admin.submit("SetClosures", pad_id=site.pad_id, closures=[closed], valid_until_ms=later)
    shut = await site.judge(await site.request("k2"))
    assert (shut["outcome"], shut["permission"]) == ("verified", "refused")
    assert "zone_active" in {each["code"] for each in shut["reasons"]}
    await site.mirror.query("ReadClosures", pad_id=site.pad_id)
    await site.fleet.submit("SetUavStatus", uav_id=site.uav_id, status="retired", reason="sold")
    await site.admin.submit("RevokeAuthorisation", uav_id=site.uav_id, authorisation_id="a1", reason="sold")
    await site.uav.is_refused(422, "UAV_RETIRED", "RequestProof", site.wish("k2"))
    # Queries that are submitted: reads, a range to its end and a range left early, a history.
    await site.mirror.submit("ReadPad", pad_id=site.pad_id)
    await site.mirror.submit("ListPrekeys", pad_id=other.pad_id)
    await other.offer(20)
    await site.mirror.submit("ListPrekeys", pad_id=other.pad_id, limit=5)
    for reached in (50, 51, 53, 102, 103, 150):  # Fabric lists 50 keys, hashes in fifty-ones, hands over a hundred
        await other.offer_until(reached)
        await site.mirror.submit("ListPrekeys", pad_id=other.pad_id, limit=100)
    await site.operator.submit("RetirePad", pad_id=site.pad_id, reason="over")
    assert people.committed > 25
    assert people.refused >= 4


async def test_what_is_invalid_is_so_on_both_and_for_the_same_reason(people, tag):
    site = await Site(people, f"{tag}-pad2msp", "Pad2MSP").ready()
    uav = site.uav
    await uav.submit("CreateAsset", TEXT, id=tag, value="0")
    stale = await uav.endorsed("UpdateAsset", id=tag, value="stale")
    two = [await uav.endorsed("RequestProof", site.wish("k0")) for _ in range(2)]
    await uav.submit("UpdateAsset", id=tag, value="fresh")
    assert (await stale.commit()).code_name == "MVCC_READ_CONFLICT"
    assert [(await each.commit()).code_name for each in two] == ["VALID", "MVCC_READ_CONFLICT"]
    top = await _height(people)
    assert (await two[0].commit()).code_name == "VALID"  # sent again: its first place counts, at once
    await people.everywhere(top)
    await people.twin.wait_for_block(top)
    for organisations in (["AuthorityMSP"], ["AuthorityMSP", "PadMSP"]):
        lacking = await site.operator.endorsed("UpdatePad", pad_id=site.pad_id, name="x", endorsed_by=organisations)
        assert (await lacking.commit()).code_name == "ENDORSEMENT_POLICY_FAILURE"
    assert commit_hash_of(await people.block(0)) == b""
    # Block by block, the same transactions with the same codes.
    mirror = people["mirror"]
    start = (await two[0].both[0].commit.status()).block_number
    top = await _height(people)
    assert people.twin.height == top
    async with mirror.network.blocks(start_block=start - 1) as stream:
        blocks = aiter(stream)
        before = await anext(blocks)
        for number in range(start, top):
            block = await anext(blocks)
            # Each peer's own word about all that it has committed, by the same rule.
            for last, this in (
                (before, block),
                [parse_block(people.twin.block(each)) for each in (number - 1, number)],
            ):
                assert commit_hash_of(this) == expected_commit_hash(commit_hash_of(last), this)
            before = block
            twin = common_pb2.Block.FromString(people.twin.block(number))
            codes = bytes(each.validation_code for each in block.transactions)
            assert twin.metadata.metadata[common_pb2.TRANSACTIONS_FILTER] == codes
            for envelopes in zip(block.envelopes, twin.data.data, strict=True):
                require_equal(*(opened_envelope(common_pb2.Envelope.FromString(each)) for each in envelopes))


@pytest.mark.parametrize("seed", range(2))
async def test_a_random_life_of_assets_is_the_same_on_both(people, tag, seed):
    """Created, changed, deleted, read, by who may and who may not, in any order."""
    chance = random.Random(seed)
    names = [f"{tag}-{index}" for index in range(3)]
    people_of_it = [people[name] for name in ("uav", "pad", "admin")]
    for step in range(25):
        who, name = chance.choice(people_of_it), chance.choice(names)
        function = chance.choice(["CreateAsset", "UpdateAsset", "UpdateAsset", "DeleteAsset", "AssetHistory"])
        fields = {"CreateAsset": {**TEXT, "value": str(step)}, "UpdateAsset": {"value": "x" * chance.randrange(1, 999)}}
        with contextlib.suppress(EndorseError):
            await who.submit(function, fields.get(function, {}), id=name)
    assert people.committed
    for name in names:
        with contextlib.suppress(Exception):
            await people["mirror"].query("AssetHistory", id=name)
