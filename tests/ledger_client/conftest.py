"""An organisation with a CA, and blocks made of its transactions."""

from __future__ import annotations

import functools
import hashlib
from dataclasses import dataclass

import pytest
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from fabric_protos.common import common_pb2, configtx_pb2
from fabric_protos.ledger.rwset import rwset_pb2
from fabric_protos.ledger.rwset.kvrwset import kv_rwset_pb2
from fabric_protos.msp import msp_config_pb2
from fabric_protos.peer import (
    chaincode_event_pb2,
    chaincode_pb2,
    proposal_pb2,
    proposal_response_pb2,
    transaction_pb2,
)

from wonderland_fabric_gateway.blocks import data_hash
from wonderland_fabric_gateway.ca import Enrolment, LocalCa
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import Signer, key_signer


@dataclass(frozen=True)
class Person:
    identity: Identity
    signer: Signer
    enrolment: Enrolment


def person(ca: LocalCa, name: str, **request) -> Person:
    enrolment = ca.enrol(name, **request)
    key = load_pem_private_key(enrolment.private_key_pem, None)
    # The same signature for the same message: ECDSA is random, and a test that shrinks needs the same bytes again.
    return Person(enrolment.identity, functools.cache(key_signer(key)), enrolment)


@pytest.fixture(scope="session")
def ca(tmp_path_factory):
    return LocalCa.create(tmp_path_factory.mktemp("ca") / "pad", "PadMSP")


@pytest.fixture(scope="session")
def pad(ca):
    return person(ca, "pad-one", attributes={"pol.role": "pad", "pol.id": "pad-1"})


@pytest.fixture(scope="session")
def peer(ca):
    return person(ca, "peer0", node_ou="peer")


class Maker:
    """Builds the bytes that a peer would deliver."""

    def __init__(self, pad: Person, peer: Person, ca: LocalCa) -> None:
        self.pad, self.peer, self.ca = pad, peer, ca

    def header(self, kind=common_pb2.ENDORSER_TRANSACTION, nonce=b"n" * 24, seconds=1_700_000_000):
        creator = self.pad.identity.creator
        channel = common_pb2.ChannelHeader(
            type=kind,
            channel_id="wonderland",
            tx_id=hashlib.sha256(nonce + creator).hexdigest(),
            extension=proposal_pb2.ChaincodeHeaderExtension(
                chaincode_id=chaincode_pb2.ChaincodeID(name="pol")
            ).SerializeToString(),
        )
        channel.timestamp.seconds, channel.timestamp.nanos = seconds, 123_456_789
        return common_pb2.Header(
            channel_header=channel.SerializeToString(),
            signature_header=common_pb2.SignatureHeader(creator=creator, nonce=nonce).SerializeToString(),
        )

    def results(self):
        version = kv_rwset_pb2.Version(block_num=3, tx_num=1)
        reads = [kv_rwset_pb2.KVRead(key="a", version=version), kv_rwset_pb2.KVRead(key="b")]
        query = kv_rwset_pb2.RangeQueryInfo(start_key="p", end_key="q", itr_exhausted=True)
        query.raw_reads.kv_reads.add(key="p1", version=version)
        merkle = kv_rwset_pb2.RangeQueryInfo(start_key="r", end_key="")
        merkle.reads_merkle_hashes.max_degree = 50
        writes = [
            kv_rwset_pb2.KVWrite(key="c", value=b"value"),
            kv_rwset_pb2.KVWrite(key="d", is_delete=True),
        ]
        keys = kv_rwset_pb2.KVRWSet(reads=reads, range_queries_info=[query, merkle], writes=writes)
        return rwset_pb2.TxReadWriteSet(
            ns_rwset=[
                rwset_pb2.NsReadWriteSet(namespace="_lifecycle"),
                rwset_pb2.NsReadWriteSet(namespace="pol", rwset=keys.SerializeToString()),
            ]
        ).SerializeToString()

    def transaction(self, args=(b"DoIt", b"{}"), event=(b"Done", b"payload"), header=None, transient_free=None):
        header = header or self.header()
        spec = chaincode_pb2.ChaincodeInvocationSpec(
            chaincode_spec=chaincode_pb2.ChaincodeSpec(input=chaincode_pb2.ChaincodeInput(args=args))
        )
        proposal = (
            transient_free or proposal_pb2.ChaincodeProposalPayload(input=spec.SerializeToString()).SerializeToString()
        )
        events = b""
        if event:
            events = chaincode_event_pb2.ChaincodeEvent(
                chaincode_id="pol", event_name=event[0].decode(), payload=event[1], tx_id="x"
            ).SerializeToString()
        action = proposal_pb2.ChaincodeAction(
            results=self.results(),
            events=events,
            response=proposal_response_pb2.Response(status=200, message="", payload=b"answer"),
            chaincode_id=chaincode_pb2.ChaincodeID(name="pol", version="1.0"),
        )
        response = proposal_response_pb2.ProposalResponsePayload(
            proposal_hash=hashlib.sha256(header.channel_header + header.signature_header + proposal).digest(),
            extension=action.SerializeToString(),
        ).SerializeToString()
        endorser = self.peer.identity.creator
        endorsement = proposal_response_pb2.Endorsement(
            endorser=endorser, signature=self.peer.signer(response + endorser)
        )
        payload = transaction_pb2.ChaincodeActionPayload(
            chaincode_proposal_payload=proposal,
            action=transaction_pb2.ChaincodeEndorsedAction(
                proposal_response_payload=response, endorsements=[endorsement]
            ),
        )
        actions = [
            transaction_pb2.TransactionAction(header=header.signature_header, payload=payload.SerializeToString())
        ]
        return self.envelope(header, transaction_pb2.Transaction(actions=actions).SerializeToString())

    def envelope(self, header, data):
        payload = common_pb2.Payload(header=header, data=data).SerializeToString()
        return common_pb2.Envelope(payload=payload, signature=self.pad.signer(payload)).SerializeToString()

    def config(self, organisations=("PadMSP",), crls=(), sections=("Application",), roots=None):
        config = configtx_pb2.ConfigEnvelope()
        config.config.sequence = 7
        for section in sections:
            for name in organisations:
                msp = msp_config_pb2.FabricMSPConfig(
                    name=name,
                    root_certs=[self.ca.root_pem()] if roots is None else roots[section],
                    tls_root_certs=[b"tls"],
                    revocation_list=crls,
                    fabric_node_ous=msp_config_pb2.FabricNodeOUs(
                        enable=True,
                        client_ou_identifier=msp_config_pb2.FabricOUIdentifier(organizational_unit_identifier="client"),
                    ),
                )
                group = config.config.channel_group.groups[section].groups[name]
                group.values["MSP"].value = msp_config_pb2.MSPConfig(
                    type=0, config=msp.SerializeToString()
                ).SerializeToString()
        header = self.header(kind=common_pb2.CONFIG)
        header.signature_header = b""
        return self.envelope(header, config.SerializeToString())

    def block(self, envelopes, number=5, codes=None, previous=b"p" * 32):
        block = common_pb2.Block()
        block.header.number = number
        block.header.previous_hash = previous
        block.header.data_hash = data_hash(list(envelopes))
        block.data.data.extend(envelopes)
        signature_header = common_pb2.SignatureHeader(creator=self.peer.identity.creator).SerializeToString()
        signatures = common_pb2.Metadata(value=b"last config")
        signatures.signatures.add(signature_header=signature_header, signature=b"s")
        signatures.signatures.add(
            identifier_header=common_pb2.IdentifierHeader(identifier=4).SerializeToString(), signature=b"t"
        )
        flags = bytes(len(envelopes)) if codes is None else bytes(codes)
        block.metadata.metadata.extend([signatures.SerializeToString(), b"", flags, b"", b""])
        return block


@pytest.fixture(scope="session")
def maker(pad, peer, ca):
    return Maker(pad, peer, ca)


class TinyContract:
    """Just enough to see every stage, event and failure."""

    version = "1.0"

    async def invoke(self, stub, function, args):
        match function:
            case "put":
                await stub.put(args[0].decode(), args[1])
                stub.set_event("Put", args[0])
                return args[1]
            case "quiet":
                await stub.put(args[0].decode(), b"quiet")
                return b""
            case "add":
                key = args[0].decode()
                total = int(await stub.get(key) or b"0") + 1
                await stub.put(key, str(total).encode())
                stub.set_event("Added", str(total).encode())
                return str(total).encode()
            case "get":
                return await stub.get(args[0].decode()) or b""
            case "who":
                return f"{stub.creator.role} {stub.creator.pol_id} {stub.tx_id}".encode()
        refusal = Exception(f"UNKNOWN_FUNCTION: there is no {function}")
        refusal.status = 404
        raise refusal


@pytest.fixture
def start_ledger(tmp_path):
    """Makes an embedded ledger on the same directory each time; use it with ``async with``."""
    from wonderland_fabric_gateway.embedded.node import EmbeddedLedger, LedgerSettings
    from wonderland_fabric_gateway.embedded.orderer import BatchLimits

    def apply(listen="127.0.0.1:0"):
        settings = LedgerSettings(listen=listen, limits=BatchLimits(time_ms=5))
        return EmbeddedLedger(tmp_path / "ledger", {"pol": TinyContract()}, settings)

    return apply


@pytest.fixture
async def ledger(start_ledger):
    async with start_ledger() as running:
        yield running


@pytest.fixture
async def gateway(ledger):
    from wonderland_fabric_gateway.gateway import Deadlines, Gateway

    connection = ledger.connection
    async with connection.open_channel() as channel:
        yield Gateway(channel, connection.identity("pad"), connection.signer("pad"), deadlines=Deadlines(locate_s=0.4))


@pytest.fixture
def network(gateway):
    return gateway.network("wonderland")


@pytest.fixture
def contract(network):
    return network.contract("pol")
