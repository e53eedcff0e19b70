"""The mirror believes no peer: whatever somebody does to the blocks that it passes on halts the mirror before it."""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace
from functools import partial

import pytest
from fabric_protos.common import common_pb2
from kit.forgers import one_endorsement_more, other_outcome, without_endorsements

from wonderland_backend.alerts.watch import alone_conditions
from wonderland_backend.db.engine import Database
from wonderland_backend.db.migrate import migrate
from wonderland_backend.errors import MirrorHalted
from wonderland_backend.mirror import store, verified
from wonderland_backend.mirror.follow import Mirror
from wonderland_backend.mirror.second_opinion import GatewayAsked, SecondOpinion
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.mirror.verified import VerifiedSource
from wonderland_fabric_gateway.blocks import BlockHeader, data_hash, parse_block
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import LedgerError, VerificationError
from wonderland_fabric_gateway.gateway import EvaluateError, Gateway
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.transactions import ValidationCode
from wonderland_fabric_gateway.verification.light_client import LightClient, signed
from wonderland_fabric_network import binaries
from wonderland_fabric_network.errors import BinaryError

pytestmark = pytest.mark.timeout(300)


class Peer:
    """A peer that passes on these blocks."""

    def __init__(self, blocks):
        self.all = list(blocks)

    async def height(self):
        return len(self.all)

    async def blocks(self, start):
        for block in self.all[start:]:
            yield block
        await asyncio.Event().wait()


async def _fetched(place):
    connection = Connection.load(place.connection_file)
    async with connection.open_channel() as channel:
        gateway = Gateway(channel, connection.identity("mirror"), connection.signer("mirror"))
        network = gateway.network(connection.channel)
        height = await network.height()
        found = []
        async with await network.blocks(start_block=0) as stream:
            while len(found) < height:
                found.append(await anext(stream))
        return found


@pytest.fixture(scope="session")
def chain(shown, aside):
    return aside(asyncio.run, _fetched(shown.place))


@pytest.fixture
async def mirror(tmp_path, shown):
    """One that mirrors into a new database, by what this peer passes on."""
    databases = []

    async def into(blocks, *, until=None, pinned=None, opinion=None, name="one", peer=None):
        database = Database(f"sqlite:///{tmp_path}/{name}.db")
        databases.append(database)
        await migrate(database)
        connection = Connection.load(shown.place.connection_file)
        policies = partial(store.endorsement_policies, database)
        source = VerifiedSource(peer or Peer(blocks), policies, pinned=pinned, opinion=opinion)
        status = MirrorStatus()
        made = Mirror(
            database,
            source,
            channel=connection.channel,
            chaincode=connection.chaincode,
            status=status,
            clock=lambda: 0,
            batch_transactions=1,
        )
        if opinion is None:
            await made.run_until(len(blocks) if until is None else until)
        else:
            await made.run()
        return status, database

    yield into
    for each in databases:
        await each.close()


async def test_every_block_of_a_real_ledger_holds_and_so_from_wherever_one_goes_on(shown, chain, mirror):
    assert sum(len(block.transactions) for block in chain) > 10
    assert len([block for block in chain if block.config is not None]) >= 2
    for until in range(1, len(chain) + 1):  # each time in the same database, from where it stopped
        status, _ = await mirror(chain, until=until)
        assert status.mirrored == until


async def test_many_blocks_are_checked_in_other_processes(shown, chain, mirror, monkeypatch):
    alone, _ = await mirror(chain, name="alone")
    monkeypatch.setattr(verified, "MANY_BLOCKS", 1)
    status, _ = await mirror(chain, name="helped")
    assert (status.mirrored, status.transactions) == (alone.mirrored, alone.transactions)
    for forge in (no_signatures, validity_of_nobody):
        with pytest.raises(MirrorHalted, match="is not to be believed: block"):
            await mirror(with_forged(chain, number_of(chain, "SubmitProof"), forge), name=forge.__name__)


def number_of(chain, function, sender=""):
    """The last block with a valid call of that function, and by that sender where one is named."""
    found = [
        block.number
        for block in chain
        for each in block.transactions
        if each.is_valid
        and each.invocation is not None
        and each.invocation.function == function
        and (not sender or each.creator.common_name == sender)
    ]
    assert found, f"nobody called {function}"
    return found[-1]


def with_slot(block, slot, value):
    metadata = list(block.metadata)
    metadata[slot] = value
    return parse_block(replace(block, metadata=tuple(metadata)).to_bytes())


def no_signatures(block):
    return with_slot(block, common_pb2.SIGNATURES, b"")


def validity_of_nobody(block):
    """What was reproduced: a real block, its codes zeroed, the orderers' signatures gone."""
    signatures = decode(common_pb2.Metadata, block.metadata[common_pb2.SIGNATURES], "", ValueError)
    del signatures.signatures[:]
    without = with_slot(block, common_pb2.SIGNATURES, signatures.SerializeToString())
    return with_slot(without, common_pb2.TRANSACTIONS_FILTER, bytes(len(block.transactions)))


def other_signature(block):
    signatures = decode(common_pb2.Metadata, block.metadata[common_pb2.SIGNATURES], "", ValueError)
    made = bytearray(signatures.signatures[0].signature)
    made[-1] ^= 1
    signatures.signatures[0].signature = bytes(made)
    return with_slot(block, common_pb2.SIGNATURES, signatures.SerializeToString())


def with_forged(chain, number, forge):
    return [*chain[:number], forge(chain[number]), *chain[number + 1 :]]


@pytest.mark.parametrize("forge", [no_signatures, validity_of_nobody, other_signature], ids=lambda each: each.__name__)
@pytest.mark.parametrize("function", ["SubmitProof", "ApproveChange"])
async def test_a_block_that_one_peer_made_up_halts_the_mirror_before_it(shown, chain, mirror, forge, function):
    number = number_of(chain, function)
    with pytest.raises(MirrorHalted, match=rf"is not to be believed: block {number}: ") as halted:
        await mirror(with_forged(chain, number, forge))
    assert "another organisation's peer" in str(halted.value)
    _, database = await mirror(chain[:number], until=number)  # what was mirrored before stands
    assert (await store.position(database)).header.number == number - 1


class Breaking(Peer):
    """A peer whose streams end, or fail, after a few blocks each."""

    def __init__(self, blocks, most, error):
        super().__init__(blocks)
        self.most, self.error, self.streams = most, error, 0

    async def blocks(self, start):
        self.streams += 1
        for block in self.all[start : start + self.most]:
            yield block
        if self.error is not None:
            raise self.error


@pytest.mark.parametrize("error", [None, LedgerError("the connection broke")], ids=["ends", "fails"])
@pytest.mark.parametrize("helped", [False, True])
async def test_what_came_before_a_stream_broke_is_mirrored(shown, chain, mirror, monkeypatch, error, helped):
    if helped:
        monkeypatch.setattr(verified, "MANY_BLOCKS", 1)
    peer = Breaking(chain[:13], 4, error)
    status, _ = await mirror(peer.all, peer=peer)
    assert status.mirrored == 13
    # Streams of four, of which the first one is there already; beside them those for configurations.
    assert peer.streams < 40


async def test_a_first_block_that_the_second_one_contradicts_is_not_kept(shown, chain, mirror):
    forged = replace(chain[0], header=replace(chain[0].header, previous_hash=b"x" * 32))
    with pytest.raises(MirrorHalted):
        await mirror([forged, *chain[1:4]])
    status, _ = await mirror(chain[:4])  # the same database, with an honest peer
    assert status.mirrored == 4


def ordered(chain, number, change, sign, *, codes=None):
    """A chain that goes on with a block of changed transactions, as an orderer could sign it."""
    block = chain[number]
    envelopes = []
    for raw in block.envelopes:
        envelope = common_pb2.Envelope.FromString(raw)
        change(envelope)
        envelopes.append(envelope.SerializeToString())
    header = BlockHeader(number, block.header.previous_hash, data_hash(envelopes))
    metadata = list(block.metadata)
    value = decode(common_pb2.Metadata, metadata[common_pb2.SIGNATURES], "", ValueError).value
    signed = common_pb2.SignatureHeader(creator=sign.creator, nonce=b"n" * 24).SerializeToString()
    message = common_pb2.Metadata(value=value)
    message.signatures.add(signature_header=signed, signature=sign.sign(value + signed + header.der))
    metadata[common_pb2.SIGNATURES] = message.SerializeToString()
    if codes is not None:
        metadata[common_pb2.TRANSACTIONS_FILTER] = codes
    made = replace(block, header=header, envelopes=tuple(envelopes), metadata=tuple(metadata))
    return [*chain[:number], parse_block(made.to_bytes())]


async def test_an_orderer_and_a_peer_together_still_lack_the_senders_and_the_endorsers(
    shown, chain, mirror, inside, thief, pad
):
    number = number_of(chain, "SubmitProof", "pad-e1")

    def nothing(_envelope):
        pass

    def sent_by_the_pad(change):
        def changed(envelope):
            change(envelope)
            envelope.signature = pad(envelope.payload)

        return changed

    for name, forged, said in (
        ("thief", ordered(chain, number, nothing, thief), "was not issued by a CA"),
        ("sender", ordered(chain, number, other_outcome, inside), "the sender’s signature"),
        ("outcome", ordered(chain, number, sent_by_the_pad(other_outcome), inside), "endorsed by nobody, which"),
        ("fewer", ordered(chain, number, sent_by_the_pad(without_endorsements), inside), "does not accept"),
    ):
        with pytest.raises(MirrorHalted, match=said):
            await mirror(forged, name=name)
    for name, change in (("true", nothing), ("more", sent_by_the_pad(one_endorsement_more))):
        status, _ = await mirror(ordered(chain, number, change, inside), name=name)  # it may sign what is true
        assert status.mirrored == number + 1


async def test_a_record_is_checked_by_its_own_policy_also_after_a_restart(shown, chain, mirror, inside, pad):
    number = number_of(chain, "SubmitProof", "pad-e1")

    def fewer(envelope):
        without_endorsements(envelope)
        envelope.signature = pad(envelope.payload)

    await mirror(chain[:number], until=number)
    with pytest.raises(MirrorHalted, match=f"block {number}: .* does not accept"):
        await mirror(ordered(chain, number, fewer, inside))


async def test_the_first_block_may_be_pinned(shown, chain, mirror):
    await mirror(chain[:2], pinned=chain[0].header.hash, name="same")
    with pytest.raises(MirrorHalted, match="not the pinned one"):
        await mirror(chain[:2], pinned=bytes(32), name="other")
    for name in ("same",):  # nor does it go on from a database that it mirrored from another
        with pytest.raises(MirrorHalted, match="not the pinned one"):
            await mirror(chain[:3], pinned=bytes(32), name=name)


def test_a_sender_with_an_odd_clock_makes_no_block_unbelievable(chain):
    """A time is only its sender's word: peers look at their own clock, and at none of a transaction that they refuse."""
    whole = next(each for each in chain[1:] if each.config is None)
    block = replace(whole, transactions=whole.transactions[:1], envelopes=whole.envelopes[:1])
    trust = LightClient.begin(chain[0]).trust
    for odd_ms in (0, 4_102_444_800_000):
        refused = replace(block.transactions[0], timestamp_ms=odd_ms, validation_code=ValidationCode.BAD_PAYLOAD)
        signed(trust, replace(block, transactions=(refused,)), now_ms=block.transactions[0].timestamp_ms)
    later = 4_102_444_800_000
    with pytest.raises(VerificationError, match="expired"):  # and where nobody's clock fits it is not believed
        signed(replace(trust, at_ms=later), replace(block, transactions=(replace(refused, timestamp_ms=later),)), later)


async def test_a_first_block_that_a_peer_calls_invalid_is_named_for_that(chain, mirror):
    beginning = replace(chain[0].transactions[0], validation_code=ValidationCode.BAD_PAYLOAD)
    with pytest.raises(MirrorHalted, match="first block is BAD_PAYLOAD, says the peer"):
        await mirror([replace(chain[0], transactions=(beginning,)), *chain[1:3]])


def test_a_configuration_that_is_left_out_is_missed(chain):
    client = LightClient.begin(chain[0])
    second = next(block for block in chain[1:] if block.config is not None)
    for block in chain[1 : second.number]:
        client.take(block)
    client.number = second.number
    with pytest.raises(Exception, match=f"its orderers name config block {second.number}; 0 is in force"):
        client.take(chain[second.number + 1])


# --- what nobody signs: validity


class Gateways:
    """What a real network's peers sign of blocks; or nobody does."""

    def __init__(self, place, *, away=()):
        self.place = place
        self.away = away
        self.asked = []

    async def block(self, number, msp_id):
        self.asked.append((number, msp_id))
        if msp_id in self.away:
            raise EvaluateError("no peer of it")
        connection = Connection.load(self.place.connection_file)
        async with connection.open_channel() as channel:
            gateway = Gateway(channel, connection.identity("mirror"), connection.signer("mirror"))
            return await GatewayAsked(gateway.network(connection.channel)).block(number, msp_id)


def own_of(place):
    return Connection.load(place.connection_file).identity("mirror").msp_id


def other_validity(chain, number, code):
    """The orderers' signatures are all there: a peer may write into its own copy what it likes."""
    return [*chain[:number], with_slot(chain[number], common_pb2.TRANSACTIONS_FILTER, bytes([code]))]


@pytest.mark.fabric
async def test_another_organisations_peer_confirms_validity(exhibits, aside, tmp_path):
    try:
        binaries.find_binaries()
    except BinaryError as error:
        pytest.skip(f"Fabric's servers are needed: {error}")
    shown = exhibits("fabric")
    chain = aside(asyncio.run, _fetched(shown.place))
    number = number_of(chain, "SubmitProof")
    assert len(chain[number].transactions) == 1
    client = LightClient.begin(chain[0])
    asked = Gateways(shown.place)
    opinion = SecondOpinion(asked, own_of(shown.place), clock=lambda: time.time_ns() // 1_000_000)
    opinion.status.alone_since_ms = 1
    for block in chain[1:]:
        await opinion.require(client.trust, block, signed(client.trust, block))
        client.take(block)
    assert asked.asked
    assert own_of(shown.place) not in {msp_id for _, msp_id in asked.asked}
    assert opinion.status.alone_since_ms is None

    forged = other_validity(chain, number, ValidationCode.MVCC_READ_CONFLICT)[-1]
    signed(client.trust, forged)  # every signature holds
    with pytest.raises(VerificationError, match=r"is MVCC_READ_CONFLICT here and VALID at \w+MSP"):
        await opinion.require(client.trust, forged, ())


async def test_a_mirror_halts_where_another_organisation_says_otherwise(shown, chain, mirror):
    class Contradicts:
        async def require(self, _trust, block, _endorsed):
            if block.number == 3:
                raise VerificationError("transaction 1 is VALID here and MVCC_READ_CONFLICT at OtherMSP")

    status, _ = await mirror(chain, opinion=Contradicts())
    assert "block 3: transaction 1 is VALID here and MVCC_READ_CONFLICT at OtherMSP" in status.halted
    assert status.mirrored == 3


async def test_who_has_nobody_to_ask_goes_on_and_says_since_when(small, aside):
    chain = aside(asyncio.run, _fetched(small.place))
    client = LightClient.begin(chain[0])
    asked = Gateways(small.place, away=("AuthorityMSP", "PadMSP", "Pad2MSP"))
    opinion = SecondOpinion(asked, own_of(small.place), clock=lambda: 77, patience_s=0.2)
    for block in chain[1:]:
        await opinion.require(client.trust, block, signed(client.trust, block))
        client.take(block)
    assert opinion.status.alone_since_ms == 77
    assert len({number for number, _ in asked.asked}) == 1  # the others do not wait for it
    (condition,) = alone_conditions(opinion.status, 77 + 60_000)
    assert (condition.kind, condition.t_ms) == ("ledger_alone", 77)
    assert not list(alone_conditions(opinion.status, 78))
