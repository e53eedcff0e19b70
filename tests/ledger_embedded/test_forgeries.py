"""What somebody without the right keys, or with them and bad intentions, sends to the ledger."""

import datetime as dt

import grpc
import pytest
from cryptography.hazmat.primitives.asymmetric import ec
from fabric_protos.common import common_pb2
from fabric_protos.gateway import gateway_pb2
from fabric_protos.ledger.rwset import rwset_pb2
from fabric_protos.ledger.rwset.kvrwset import kv_rwset_pb2
from fabric_protos.peer import proposal_pb2, proposal_response_pb2, transaction_pb2
from google.rpc import status_pb2

from wonderland_fabric_gateway.ca import LocalCa
from wonderland_fabric_gateway.embedded.config_update import SigningIdentity
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import key_signer
from wonderland_fabric_gateway.transactions import ValidationCode


async def refusal(call):
    """Status code and all texts of a refused call."""
    with pytest.raises(grpc.aio.AioRpcError) as caught:
        await call
    error = caught.value
    texts = [error.details()]
    data = dict(error.trailing_metadata()).get("grpc-status-details-bin")
    if data:
        texts += [
            gateway_pb2.ErrorDetail.FromString(each.value).message
            for each in status_pb2.Status.FromString(data).details
        ]
    return error.code(), " | ".join(texts)


async def submit_and_ask(world, tx_id, envelope):
    """The validation code that a submitted transaction gets."""
    await world.submit(tx_id, envelope)
    code, _ = await world.status(tx_id)
    return ValidationCode(code).name


class Opened:
    """A prepared transaction taken apart, to be changed and put together again."""

    def __init__(self, envelope):
        self.payload = common_pb2.Payload.FromString(envelope.payload)
        self.transaction = transaction_pb2.Transaction.FromString(self.payload.data)
        self.action = transaction_pb2.ChaincodeActionPayload.FromString(self.transaction.actions[0].payload)
        self.response = proposal_response_pb2.ProposalResponsePayload.FromString(
            self.action.action.proposal_response_payload
        )
        self.result = proposal_pb2.ChaincodeAction.FromString(self.response.extension)

    def write(self, key, value):
        """Add a write to what the contract did."""
        rwset = rwset_pb2.TxReadWriteSet.FromString(self.result.results)
        kv = kv_rwset_pb2.KVRWSet.FromString(rwset.ns_rwset[0].rwset)
        kv.writes.add(key=key, value=value)
        rwset.ns_rwset[0].rwset = kv.SerializeToString()
        self.result.results = rwset.SerializeToString()

    def close(self, who):
        """The signed envelope with all changes."""
        self.response.extension = self.result.SerializeToString()
        self.action.action.proposal_response_payload = self.response.SerializeToString()
        self.transaction.actions[0].payload = self.action.SerializeToString()
        self.payload.data = self.transaction.SerializeToString()
        payload = self.payload.SerializeToString()
        return common_pb2.Envelope(payload=payload, signature=who.sign(payload))

    def endorse(self, *signers):
        """Replace the endorsements by these signers', over the content as it is now."""
        self.response.extension = self.result.SerializeToString()
        content = self.response.SerializeToString()
        self.action.action.proposal_response_payload = content
        del self.action.action.endorsements[:]
        for each in signers:
            self.action.action.endorsements.add(endorser=each.creator, signature=each.sign(content + each.creator))


@pytest.fixture
def prepared(world, make_proposal):
    async def prepare(*args, name="pad"):
        who = world.signing(name)
        proposal = make_proposal(who, *(args or ("put", "key", "honest")))
        return who, proposal, Opened(await world.endorse(proposal))

    return prepare


async def test_an_unchanged_transaction_taken_apart_is_valid(world, prepared):
    """The control: taking apart and putting together is not what the others are refused for."""
    who, proposal, opened = await prepared()
    assert await submit_and_ask(world, proposal.tx_id, opened.close(who)) == "VALID"


async def test_an_unchanged_transaction_is_valid_after_a_restart_too(tmp_path, open_world, make_proposal):
    """Then nothing is remembered of what was endorsed, and every check is made anew."""
    async with open_world(tmp_path / "l") as world:
        who = world.signing()
        proposal = make_proposal(who, "put", "key", "honest")
        opened = Opened(await world.endorse(proposal))
    async with open_world(tmp_path / "l") as world:
        assert await submit_and_ask(world, proposal.tx_id, opened.close(who)) == "VALID"
        assert await world.contract().evaluate("get", "key") == b"honest"


async def test_a_forged_write_set_is_not_endorsed(world, prepared):
    who, proposal, opened = await prepared()
    opened.write("pad/pad-1", b"mine")
    assert await submit_and_ask(world, proposal.tx_id, opened.close(who)) == "ENDORSEMENT_POLICY_FAILURE"
    assert await world.contract().evaluate("get", "pad/pad-1") == b"<none>"
    assert await world.contract().evaluate("get", "key") == b"<none>"


async def test_a_forged_result_or_event_is_not_endorsed(world, prepared):
    who, proposal, opened = await prepared()
    opened.result.response.payload = b"verified"
    opened.result.events = b""
    assert await submit_and_ask(world, proposal.tx_id, opened.close(who)) == "ENDORSEMENT_POLICY_FAILURE"


async def test_endorsements_by_clients_do_not_count(world, prepared):
    who, proposal, opened = await prepared()
    opened.write("k", b"v")
    opened.endorse(world.signing("admin"), world.signing("pad_operator"))
    assert await submit_and_ask(world, proposal.tx_id, opened.close(who)) == "ENDORSEMENT_POLICY_FAILURE"


async def test_endorsements_by_other_peers_of_the_same_organisations_do_not_count(world, prepared):
    """A CA could certify further peers; this ledger knows its own."""
    who, proposal, opened = await prepared()
    opened.write("k", b"v")
    others = []
    for msp_id in ("AuthorityMSP", "PadMSP"):
        key = ec.generate_private_key(ec.SECP256R1())
        enrolment = world.ledger.directory.ca(msp_id).enrol("second-peer", node_ou="peer", public_key=key.public_key())
        others.append(SigningIdentity(Identity(msp_id, enrolment.certificate_pem), key_signer(key)))
    opened.endorse(*others)
    assert await submit_and_ask(world, proposal.tx_id, opened.close(who)) == "ENDORSEMENT_POLICY_FAILURE"


async def test_one_endorsement_twice_is_not_two(world, prepared):
    who, proposal, opened = await prepared()
    del opened.action.action.endorsements[1]
    opened.action.action.endorsements.append(opened.action.action.endorsements[0])
    assert await submit_and_ask(world, proposal.tx_id, opened.close(who)) == "ENDORSEMENT_POLICY_FAILURE"


async def test_a_high_s_endorsement_does_not_count(world, prepared, high_s):
    who, proposal, opened = await prepared()
    endorsement = opened.action.action.endorsements[0]
    endorsement.signature = high_s(endorsement.signature)
    assert await submit_and_ask(world, proposal.tx_id, opened.close(who)) == "ENDORSEMENT_POLICY_FAILURE"


async def test_other_arguments_than_were_endorsed_break_the_proposal_hash(world, prepared):
    who, proposal, opened = await prepared()
    other = proposal_pb2.ChaincodeProposalPayload.FromString(opened.action.chaincode_proposal_payload)
    other.input = other.input.replace(b"honest", b"forged")
    opened.action.chaincode_proposal_payload = other.SerializeToString()
    assert await submit_and_ask(world, proposal.tx_id, opened.close(who)) == "INVALID_ENDORSER_TRANSACTION"


async def test_an_endorsed_result_does_not_serve_under_another_header(world, prepared, make_proposal):
    """Somebody else's endorsement, moved under one's own creator and transaction id."""
    _, _, opened = await prepared(name="pad")
    thief = world.signing("uav")
    own = make_proposal(thief, "get", "x")
    header = common_pb2.Header.FromString(proposal_pb2.Proposal.FromString(own.signed.proposal_bytes).header)
    opened.payload.header.CopyFrom(header)
    assert await submit_and_ask(world, own.tx_id, opened.close(thief)) == "INVALID_ENDORSER_TRANSACTION"
    opened.transaction.actions[0].header = header.signature_header
    assert await submit_and_ask(world, own.tx_id, opened.close(thief)) == "INVALID_ENDORSER_TRANSACTION"


async def test_a_wrong_transaction_id_in_the_envelope(world, prepared):
    who, _, opened = await prepared()
    header = common_pb2.ChannelHeader.FromString(opened.payload.header.channel_header)
    header.tx_id = "00" * 32
    opened.payload.header.channel_header = header.SerializeToString()
    assert await submit_and_ask(world, "00" * 32, opened.close(who)) == "BAD_PROPOSAL_TXID"


@pytest.mark.parametrize("content", [b"", b"\xff\xff", b"\x0a\x00", b"\x0a\x02\x0a\x00"])
async def test_rubbish_inside_a_signed_envelope_is_invalid_and_streams_survive_it(world, prepared, content):
    who, proposal, opened = await prepared()
    opened.payload.data = content
    payload = opened.payload.SerializeToString()
    envelope = common_pb2.Envelope(payload=payload, signature=who.sign(payload))
    assert await submit_and_ask(world, proposal.tx_id, envelope) == "INVALID_ENDORSER_TRANSACTION"
    for kind in ("Deliver", "DeliverFiltered", "DeliverWithPrivateData"):
        call = world.seek(world.signing("mirror"), 0, 1, kind=kind)
        assert [len(await call.read()) > 0 for _ in range(3)] == [True] * 3
        call.cancel()


async def test_a_transaction_submitted_twice_counts_once(world, prepared):
    who, proposal, opened = await prepared("increment", "n")
    envelope = opened.close(who)
    assert await submit_and_ask(world, proposal.tx_id, envelope) == "VALID"
    await world.submit(proposal.tx_id, envelope)
    await world.chain.wait_for_block(2)
    block = common_pb2.Block.FromString(world.chain.block(2))
    assert block.metadata.metadata[common_pb2.TRANSACTIONS_FILTER] == bytes([ValidationCode.DUPLICATE_TXID])
    assert await world.status(proposal.tx_id) == (ValidationCode.VALID, 1)
    assert await world.contract().evaluate("get", "n") == b"1"


async def test_a_used_transaction_id_is_not_endorsed_again(world, prepared):
    who, proposal, opened = await prepared()
    await submit_and_ask(world, proposal.tx_id, opened.close(who))
    code, text = await refusal(world.endorse(proposal))
    assert code is grpc.StatusCode.ABORTED
    assert "duplicate transaction found" in text


async def test_submit_without_or_with_a_wrong_signature(world, prepared, high_s):
    who, proposal, opened = await prepared()
    good = opened.close(who)
    for signature in (world.signing("uav").sign(good.payload), b"rubbish", high_s(good.signature), good.signature[:-1]):
        bad = common_pb2.Envelope(payload=good.payload, signature=signature)
        code, text = await refusal(world.submit(proposal.tx_id, bad))
        assert code is grpc.StatusCode.ABORTED
        assert "status=FORBIDDEN" in text
    code, text = await refusal(world.submit(proposal.tx_id, common_pb2.Envelope(payload=good.payload)))
    assert code is grpc.StatusCode.INVALID_ARGUMENT
    assert "must be signed" in text
    assert await submit_and_ask(world, proposal.tx_id, good) == "VALID"


async def test_config_transactions_cannot_be_submitted_by_clients(world, prepared):
    who, proposal, opened = await prepared(name="admin")
    header = common_pb2.ChannelHeader.FromString(opened.payload.header.channel_header)
    header.type = common_pb2.CONFIG
    opened.payload.header.channel_header = header.SerializeToString()
    code, text = await refusal(world.submit(proposal.tx_id, opened.close(who)))
    assert code is grpc.StatusCode.ABORTED
    assert "only endorsed transactions" in text


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"tx_id": "ab" * 32}, "incorrectly computed txid"),
        ({"signature": b""}, "DER"),
        ({"signature": b"\x30\x06\x02\x01\x01\x02\x01\x01"}, "not made by this key"),
        ({"at": dt.datetime(2020, 1, 1, tzinfo=dt.UTC)}, "behind the ledger's clock"),
        ({"at": dt.datetime(2120, 1, 1, tzinfo=dt.UTC)}, "ahead of the ledger's clock"),
        ({"creator": b"\x0a\x06PadMSP\x12\x03abc"}, "creator is malformed"),
    ],
)
async def test_proposals_that_are_refused_with_details(world, make_proposal, change, says):
    code, text = await refusal(world.endorse(make_proposal(world.signing(), "get", "x", **change)))
    assert code is grpc.StatusCode.ABORTED
    assert says in text


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"nonce": b""}, "nonce"),
        ({"nonce": b"x" * 5000}, "nonce"),
        ({"creator": b""}, "names no creator"),
        ({"type": common_pb2.CONFIG_UPDATE}, "header type 2"),
        ({"epoch": 7}, "epoch"),
        ({"at": False}, "is no time"),
        ({"header_chaincode": "other"}, "same chaincode"),
    ],
)
async def test_malformed_proposals(world, make_proposal, change, says):
    code, text = await refusal(world.endorse(make_proposal(world.signing(), "get", "x", **change)))
    assert code is grpc.StatusCode.INVALID_ARGUMENT
    assert says in text


async def test_a_proposal_that_is_too_large(world, make_proposal):
    code, text = await refusal(world.endorse(make_proposal(world.signing(), "put", "k", "x" * (5 << 20))))
    assert code is grpc.StatusCode.INVALID_ARGUMENT
    assert "the limit is 4194304" in text


async def test_a_high_s_proposal_signature(world, make_proposal, high_s):
    who = world.signing()
    proposal = make_proposal(who, "get", "x", sign=lambda data: high_s(who.sign(data)))
    code, text = await refusal(world.endorse(proposal))
    assert code is grpc.StatusCode.ABORTED
    assert "high-S" in text


async def test_a_certificate_of_another_organisations_ca(world, make_proposal):
    """The key and certificate of a fleet's drone, dressed up as a pad's."""
    uav = world.signing("uav")
    fake = SigningIdentity(Identity("PadMSP", uav.identity.certificate_pem), uav.sign)
    code, text = await refusal(world.endorse(make_proposal(fake, "get", "x")))
    assert code is grpc.StatusCode.ABORTED
    assert "not issued by a CA of that organisation" in text


async def test_a_ca_with_the_same_name_but_another_key(world, make_proposal, tmp_path):
    impostor = LocalCa.create(tmp_path / "impostor", "PadMSP")
    key = ec.generate_private_key(ec.SECP256R1())
    enrolment = impostor.enrol("pad", attributes={"pol.role": "pad", "pol.id": "pad-1"}, public_key=key.public_key())
    fake = SigningIdentity(enrolment.identity, key_signer(key))
    _, text = await refusal(world.endorse(make_proposal(fake, "get", "x")))
    assert "not issued by a CA of that organisation" in text


async def test_an_organisation_that_is_not_on_the_channel(world, make_proposal):
    pad = world.signing("pad")
    fake = SigningIdentity(Identity("NobodyMSP", pad.identity.certificate_pem), pad.sign)
    _, text = await refusal(world.endorse(make_proposal(fake, "get", "x")))
    assert "creator org unknown" in text


async def test_the_orderers_organisation_may_not_use_the_channel(world, make_proposal):
    orderer = world.chain.settings.signers.orderer
    _, text = await refusal(world.endorse(make_proposal(orderer, "get", "x")))
    assert "no member of the application channel" in text


async def test_an_expired_certificate(world, make_proposal):
    who = world.signing()
    world.clock.offset = dt.timedelta(days=366)
    later = dt.datetime.now(dt.UTC) + world.clock.offset
    _, text = await refusal(world.endorse(make_proposal(who, "get", "x", at=later)))
    assert "has expired; renew it" in text
    world.clock.offset = dt.timedelta(days=-30)
    earlier = dt.datetime.now(dt.UTC) + world.clock.offset
    _, text = await refusal(world.endorse(make_proposal(who, "get", "x", at=earlier)))
    assert "is not valid yet" in text


async def test_a_certificate_that_expires_between_endorsement_and_submission(world, prepared):
    who, proposal, opened = await prepared()
    world.clock.offset = dt.timedelta(days=366)
    code, text = await refusal(world.submit(proposal.tx_id, opened.close(who)))
    assert code is grpc.StatusCode.ABORTED
    assert "has expired" in text


async def test_a_revoked_certificate_everywhere(world, make_proposal, prepared):
    who, proposal, opened = await prepared(name="uav")
    ca = world.ledger.directory.ca("FleetMSP")
    ca.revoke(name="uav")
    assert await world.ledger.refresh_revocations() == 1
    assert await world.ledger.refresh_revocations() is None
    _, text = await refusal(world.endorse(make_proposal(who, "get", "x")))
    assert "is revoked" in text
    _, text = await refusal(world.submit(proposal.tx_id, opened.close(who)))
    assert "status=FORBIDDEN" in text
    code, text = await refusal(world.status(proposal.tx_id, name="uav"))
    assert code is grpc.StatusCode.PERMISSION_DENIED
    assert await world.contract("fleet_operator").evaluate("get", "x") == b"<none>"


async def test_revoked_between_submission_and_block(tmp_path, open_world, make_proposal):
    from wonderland_fabric_gateway.embedded.orderer import BatchLimits

    async with open_world(tmp_path / "l", limits=BatchLimits(time_ms=60_000)) as world:
        who = world.signing("uav")
        proposal = make_proposal(who, "put", "k", "v")
        envelope = await world.endorse(proposal)
        envelope.signature = who.sign(envelope.payload)
        await world.submit(proposal.tx_id, envelope)
        world.ledger.directory.ca("FleetMSP").revoke(name="uav")
        assert await world.ledger.refresh_revocations() == 1
        code, block = await world.status(proposal.tx_id)
        assert (ValidationCode(code).name, block) == ("BAD_CREATOR_SIGNATURE", 2)
        assert await world.contract().evaluate("get", "k") == b"<none>"


async def test_commit_status_needs_a_member_and_its_signature(world):
    pad, uav = world.signing("pad"), world.signing("uav")
    request = gateway_pb2.CommitStatusRequest(
        transaction_id="ab" * 32, channel_id="wonderland", identity=pad.creator
    ).SerializeToString()
    signed = gateway_pb2.SignedCommitStatusRequest(request=request, signature=uav.sign(request))
    code, _ = await refusal(world.unary("CommitStatus", signed))
    assert code is grpc.StatusCode.PERMISSION_DENIED
