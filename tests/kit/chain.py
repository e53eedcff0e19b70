"""A ledger made of valid blocks without a ledger: authorities, transactions, a chain, a source of its blocks."""

from __future__ import annotations

import asyncio
import hashlib
from dataclasses import dataclass, field

import pytest
from fabric_protos.common import common_pb2
from fabric_protos.ledger.rwset import rwset_pb2
from fabric_protos.ledger.rwset.kvrwset import kv_rwset_pb2
from fabric_protos.peer import (
    chaincode_event_pb2,
    chaincode_pb2,
    proposal_pb2,
    proposal_response_pb2,
    transaction_pb2,
)

from wonderland.proofs import encoding
from wonderland_fabric_gateway.blocks import BlockHeader, data_hash, parse_block
from wonderland_fabric_gateway.ca import Kind
from wonderland_fabric_gateway.ca.local import LocalCa
from wonderland_fabric_gateway.embedded.genesis import ChannelDescription, OrganisationDescription, genesis_block

START_MS = 1_800_000_000_000
MSPS = ("AuthorityMSP", "PadMSP", "FleetMSP")


def number(*parts):
    """64 hexadecimal digits that depend on the parts."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()


class Authorities:
    """The organisations' CAs, and identities by name, enrolled when first asked for."""

    def __init__(self, directory):
        self.cas = {msp: LocalCa.create(directory / msp, msp) for msp in (*MSPS, "OrdererMSP")}
        self.enrolled = {}

    def enrol(self, name, msp_id="PadMSP", **attributes):
        key = (name, msp_id, *sorted(attributes.items()))
        if key not in self.enrolled:
            node_ou = attributes.pop("node_ou", "client")
            named = {f"pol.{each}": value for each, value in attributes.items()}
            unique = f"{name}-{len(self.enrolled)}"
            self.enrolled[key] = self.cas[msp_id].enrol(unique, node_ou=node_ou, attributes=named)
        return self.enrolled[key]

    def creator(self, name, msp_id="PadMSP", **attributes):
        return self.enrol(name, msp_id, **attributes).identity.creator

    def genesis(self, channel="wonderland"):
        def described(msp_id):
            ca = self.cas[msp_id]
            return OrganisationDescription(msp_id, ca.root_pem(), ca.root_pem(Kind.TLS))

        description = ChannelDescription(
            channel, tuple(described(msp) for msp in MSPS), described("OrdererMSP"), ("AuthorityMSP", "PadMSP"), 10, 500
        )
        return genesis_block(description, START_MS // 1000, b"n" * 24)


@dataclass
class Tx:
    """A transaction to be: what it calls, what it writes (None: deletes), what its event is."""

    function: str = "Touch"
    argument: object = None
    writes: dict = field(default_factory=dict)
    event: tuple | None = None
    code: int = 0
    t_ms: int = START_MS
    chaincode: str = "pol"
    tx_id: str = ""
    broken: bool = False


class ChainBuilder:
    """A chain of valid blocks, made without a ledger."""

    def __init__(self, authorities, channel="wonderland"):
        self.channel = channel
        self.authorities = authorities
        header, block = authorities.genesis(channel)
        self.headers = [header]
        self.blocks = [block]
        self.creator = authorities.creator("pad-1", role="pad", id="pad-1")
        self.endorsers = [
            authorities.creator("peer", "AuthorityMSP", node_ou="peer"),
            authorities.creator("peer", "PadMSP", node_ou="peer"),
        ]
        self.arrived = asyncio.Event()
        self.count = 0

    @property
    def height(self):
        return len(self.blocks)

    def add(self, *transactions):
        """Append a block; returns the ids of its transactions."""
        ids, envelopes = [], []
        for transaction in transactions:
            self.count += 1
            tx_id = transaction.tx_id or number("tx", self.count)
            ids.append(tx_id)
            envelopes.append(b"\xff\x00broken" if transaction.broken else self.envelope(transaction, tx_id))
        self.append(envelopes, bytes(each.code for each in transactions))
        return ids

    def append(self, envelopes, codes, previous=None, at=None):
        before = self.headers[-1]
        header = BlockHeader(before.number + 1 if at is None else at, previous or before.hash, data_hash(envelopes))
        metadata = [b""] * 5
        metadata[common_pb2.TRANSACTIONS_FILTER] = codes
        block = common_pb2.Block(
            header=common_pb2.BlockHeader(
                number=header.number, previous_hash=header.previous_hash, data_hash=header.data_hash
            ),
            data=common_pb2.BlockData(data=envelopes),
            metadata=common_pb2.BlockMetadata(metadata=metadata),
        )
        self.headers.append(header)
        self.blocks.append(block.SerializeToString())
        self.arrived.set()
        self.arrived = asyncio.Event()

    def envelope(self, transaction, tx_id):
        args = [transaction.function.encode()]
        if transaction.argument is not None:
            argument = transaction.argument
            args.append(argument if isinstance(argument, bytes) else encoding.encode(argument))
        writes = [
            kv_rwset_pb2.KVWrite(key=key, value=value or b"", is_delete=value is None)
            for key, value in transaction.writes.items()
        ]
        results = rwset_pb2.TxReadWriteSet(
            ns_rwset=[
                rwset_pb2.NsReadWriteSet(
                    namespace=transaction.chaincode,
                    rwset=kv_rwset_pb2.KVRWSet(writes=writes).SerializeToString(),
                )
            ]
        )
        action = proposal_pb2.ChaincodeAction(
            results=results.SerializeToString(),
            response=proposal_response_pb2.Response(status=200),
            chaincode_id=chaincode_pb2.ChaincodeID(name=transaction.chaincode, version="1"),
        )
        if transaction.event is not None:
            name, payload = transaction.event
            action.events = chaincode_event_pb2.ChaincodeEvent(
                chaincode_id=transaction.chaincode, tx_id=tx_id, event_name=name, payload=payload
            ).SerializeToString()
        spec = chaincode_pb2.ChaincodeInvocationSpec(
            chaincode_spec=chaincode_pb2.ChaincodeSpec(
                chaincode_id=chaincode_pb2.ChaincodeID(name=transaction.chaincode),
                input=chaincode_pb2.ChaincodeInput(args=args),
            )
        )
        payload = transaction_pb2.ChaincodeActionPayload(
            chaincode_proposal_payload=proposal_pb2.ChaincodeProposalPayload(
                input=spec.SerializeToString()
            ).SerializeToString(),
            action=transaction_pb2.ChaincodeEndorsedAction(
                proposal_response_payload=proposal_response_pb2.ProposalResponsePayload(
                    proposal_hash=b"h" * 32, extension=action.SerializeToString()
                ).SerializeToString(),
                endorsements=[
                    proposal_response_pb2.Endorsement(endorser=each, signature=b"s") for each in self.endorsers
                ],
            ),
        )
        header = common_pb2.ChannelHeader(type=common_pb2.ENDORSER_TRANSACTION, channel_id=self.channel, tx_id=tx_id)
        header.timestamp.seconds, rest = divmod(transaction.t_ms, 1000)
        header.timestamp.nanos = rest * 1_000_000
        return common_pb2.Envelope(
            payload=common_pb2.Payload(
                header=common_pb2.Header(
                    channel_header=header.SerializeToString(),
                    signature_header=common_pb2.SignatureHeader(
                        creator=self.creator, nonce=b"n" * 24
                    ).SerializeToString(),
                ),
                data=transaction_pb2.Transaction(
                    actions=[transaction_pb2.TransactionAction(payload=payload.SerializeToString())]
                ).SerializeToString(),
            ).SerializeToString(),
            signature=b"s",
        ).SerializeToString()


class Source:
    """The chain as a block source. `fail` is raised once when next asked; `cut` ends the stream."""

    def __init__(self, chain):
        self.chain = chain
        self.fail = None
        self.opened = 0
        self.limit = None

    async def height(self):
        if self.fail is not None:
            error, self.fail = self.fail, None
            raise error
        return self.chain.height

    async def blocks(self, start):
        self.opened += 1
        at = start
        while True:
            arrived = self.chain.arrived
            while at < len(self.chain.blocks) and (self.limit is None or at < self.limit):
                yield parse_block(self.chain.blocks[at])
                at += 1
            waiting = asyncio.create_task(arrived.wait())
            try:
                while not waiting.done():
                    if self.fail is not None:
                        error, self.fail = self.fail, None
                        raise error
                    await asyncio.wait([waiting], timeout=0.01)
            finally:
                waiting.cancel()


@pytest.fixture(scope="session")
def authorities(tmp_path_factory):
    return Authorities(tmp_path_factory.mktemp("ca"))


@pytest.fixture
def chain(authorities):
    return ChainBuilder(authorities)


@pytest.fixture(name="new_chain")
def _new_chain(authorities):
    return lambda **options: ChainBuilder(authorities, **options)


@pytest.fixture(name="tx")
def _tx():
    return Tx


@pytest.fixture(name="source_of")
def _source_of():
    return Source


@pytest.fixture(name="number")
def _number():
    return number
