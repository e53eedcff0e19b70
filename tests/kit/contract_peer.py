"""A peer that is none: it dials a contract service as Fabric's peer does, and simulates on the embedded ledger's stub.

So the read-write set of each transaction comes out encoded, and can be compared byte for byte with what the embedded
ledger makes of the same contract, state and proposal. Like Fabric's, it drops a second question in flight.
"""

from __future__ import annotations

import asyncio
import datetime as dt
import hashlib
import json
import os
import types
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from typing import Any

import grpc
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import NameOID
from fabric_protos.common import common_pb2
from fabric_protos.ledger.queryresult import kv_query_result_pb2
from fabric_protos.msp import identities_pb2
from fabric_protos.peer import chaincode_pb2, proposal_pb2, proposal_response_pb2
from fabric_protos.peer import chaincode_shim_pb2 as shim
from prometheus_client.parser import text_string_to_metric_families

from wonderland_chaincode.service import ContractServer, Limits
from wonderland_chaincode.service.metrics import Metrics
from wonderland_fabric_gateway.attributes import ATTRIBUTES_OID, encode_attributes
from wonderland_fabric_gateway.embedded import rwset as rwsets
from wonderland_fabric_gateway.embedded.stub import TransactionStub

M = shim.ChaincodeMessage
PACKAGE_ID = "pol_1.0:" + "ab" * 32
START_MS = 1_800_000_000_000
CHANNEL = "wonderland"


class State:
    """Committed keys with their versions, and their past, as `StateReader` shows them."""

    def __init__(self, **values):
        self.now: dict[str, tuple[bytes, tuple[int, int]]] = {}
        self.past: dict[str, list[Any]] = {}
        self.block = 0
        self.commit(values)

    def commit(self, values, tx_id="00" * 32, timestamp_ms=START_MS):
        self.block += 1
        for index, (key, value) in enumerate(values.items()):
            data = value.encode() if isinstance(value, str) else value
            change = types.SimpleNamespace(
                tx_id=tx_id, timestamp_ms=timestamp_ms, value=data or b"", is_delete=data is None
            )
            self.past.setdefault(key, []).insert(0, change)
            if data is None:
                self.now.pop(key, None)
            else:
                self.now[key] = data, (self.block, index)

    def get(self, _namespace, key):
        return self.now.get(key)

    def range(self, _namespace, start, end):
        for key in sorted(self.now, key=str.encode):
            if start.encode() <= key.encode() and (not end or key.encode() < end.encode()):
                value, version = self.now[key]
                yield key, value, version

    def history(self, _namespace, key):
        yield from self.past.get(key, [])

    @contextmanager
    def snapshot(self):
        yield


@dataclass(frozen=True)
class Person:
    """Who signs: a certificate as a Fabric CA issues it."""

    name: str = "ada"
    msp_id: str = "AuthorityMSP"
    attributes: tuple[tuple[str, str], ...] = (("pol.role", "admin"), ("pol.id", ""))
    node_ou: str = "client"
    number: int = 7

    @property
    def creator(self) -> bytes:
        return identities_pb2.SerializedIdentity(
            mspid=self.msp_id, id_bytes=certificate(self).public_bytes(Encoding.PEM)
        ).SerializeToString()


_certificates: dict[Person, x509.Certificate] = {}


def certificate(person):
    if person not in _certificates:
        key = ec.derive_private_key(person.number, ec.SECP256R1())
        name = x509.Name(
            [
                x509.NameAttribute(NameOID.ORGANIZATIONAL_UNIT_NAME, person.node_ou),
                x509.NameAttribute(NameOID.COMMON_NAME, person.name),
            ]
        )
        builder = x509.CertificateBuilder(
            name,
            name,
            key.public_key(),
            person.number,
            dt.datetime(2026, 1, 1, tzinfo=dt.UTC),
            dt.datetime(2040, 1, 1, tzinfo=dt.UTC),
        ).add_extension(
            x509.UnrecognizedExtension(ATTRIBUTES_OID, encode_attributes(dict(person.attributes))), critical=False
        )
        _certificates[person] = builder.sign(key, hashes.SHA256())
    return _certificates[person]


@dataclass(frozen=True)
class Call:
    """A proposal, as the client made it."""

    function: str | bytes
    args: tuple[Any, ...] = ()
    who: Person = field(default_factory=Person)
    timestamp_ms: int = START_MS
    nonce: bytes = field(default_factory=lambda: os.urandom(24))
    channel: str = CHANNEL

    @property
    def creator(self):
        return self.who.creator

    @property
    def tx_id(self):
        return hashlib.sha256(self.nonce + self.creator).hexdigest()

    @property
    def raw_args(self):
        return [each if isinstance(each, bytes) else each.encode() for each in (self.function, *self.args)]

    def signed_proposal(self, **change):
        header = common_pb2.ChannelHeader(
            type=common_pb2.ENDORSER_TRANSACTION,
            channel_id=change.get("channel", self.channel),
            tx_id=change.get("tx_id", self.tx_id),
        )
        header.timestamp.FromMilliseconds(self.timestamp_ms)
        sender = common_pb2.SignatureHeader(creator=change.get("creator", self.creator), nonce=self.nonce)
        spec = chaincode_pb2.ChaincodeInvocationSpec()
        spec.chaincode_spec.input.args.extend(self.raw_args)
        proposal = proposal_pb2.Proposal(
            header=common_pb2.Header(
                channel_header=header.SerializeToString(), signature_header=sender.SerializeToString()
            ).SerializeToString(),
            payload=proposal_pb2.ChaincodeProposalPayload(input=spec.SerializeToString()).SerializeToString(),
        )
        return proposal_pb2.SignedProposal(proposal_bytes=proposal.SerializeToString(), signature=b"not looked at")

    def message(self, **change):
        call = chaincode_pb2.ChaincodeInput(args=self.raw_args)
        return M(
            type=change.get("type", M.TRANSACTION),
            txid=self.tx_id,
            channel_id=self.channel,
            payload=call.SerializeToString(),
            proposal=self.signed_proposal(**change),
        )


@dataclass
class Answered:
    """How a transaction ended, and what the peer saw of it."""

    kind: int
    status: int
    text: str
    payload: bytes
    event: tuple[str, bytes] | None
    rwset: Any
    calls: list[str]


class Simulation:
    """One transaction at the peer: it answers the contract's questions."""

    def __init__(self, call, state, page):
        self.stub = TransactionStub(
            state, "pol", channel=call.channel, tx_id=call.tx_id, timestamp_ms=call.timestamp_ms, creator=None
        )
        self.page = page
        self.queries: dict[str, Any] = {}
        self.calls: list[str] = []
        self.answered: asyncio.Future[Any] = asyncio.get_running_loop().create_future()

    async def answer(self, message):
        self.calls.append(M.Type.Name(message.type))
        match message.type:
            case M.GET_STATE:
                return await self.stub.get(shim.GetState.FromString(message.payload).key) or b""
            case M.GET_STATE_MULTIPLE:
                values = await self.stub.get_many(shim.GetStateMultiple.FromString(message.payload).keys)
                found = shim.GetStateMultipleResult(values=[value or b"" for value in values])
                return found.SerializeToString()
            case M.PUT_STATE_METADATA:
                put = shim.PutStateMetadata.FromString(message.payload)
                self.put_metadata(put.key, put.metadata)
            case M.PUT_STATE:
                put = shim.PutState.FromString(message.payload)
                await self.stub.put(put.key, put.value)
            case M.DEL_STATE:
                await self.stub.delete(shim.DelState.FromString(message.payload).key)
            case M.WRITE_BATCH_STATE:
                for record in shim.WriteBatchState.FromString(message.payload).rec:
                    if record.type == shim.WriteRecord.DEL_STATE:
                        await self.stub.delete(record.key)
                    elif record.type == shim.WriteRecord.PUT_STATE_METADATA:
                        self.put_metadata(record.key, record.metadata)
                    else:
                        await self.stub.put(record.key, record.value)
            case M.GET_STATE_BY_RANGE:
                asked = shim.GetStateByRange.FromString(message.payload)
                rows = self.stub.range(asked.startKey, asked.endKey)
                return await self.more(f"q{len(self.calls)}", rows, self.key_value)
            case M.GET_HISTORY_FOR_KEY:
                rows = self.stub.history(shim.GetHistoryForKey.FromString(message.payload).key)
                return await self.more(f"q{len(self.calls)}", rows, self.modification)
            case M.QUERY_STATE_NEXT:
                query_id = shim.QueryStateNext.FromString(message.payload).id
                return await self.more(query_id, *self.queries.pop(query_id))
            case M.QUERY_STATE_CLOSE:
                del self.queries[shim.QueryStateClose.FromString(message.payload).id]
            case other:
                raise AssertionError(f"a peer knows no {other}")
        return b""

    def put_metadata(self, key, metadata):
        assert metadata.metakey == "VALIDATION_PARAMETER"
        self.stub._policies[key] = metadata.value

    async def more(self, query_id, rows, encode):
        response = shim.QueryResponse(id=query_id)
        while len(response.results) < self.page:
            row = await anext(rows, None)
            if row is None:
                return response.SerializeToString()
            response.results.add(resultBytes=encode(row))
        response.has_more = True
        self.queries[query_id] = rows, encode
        return response.SerializeToString()

    @staticmethod
    def key_value(row):
        return kv_query_result_pb2.KV(namespace="pol", key=row[0], value=row[1]).SerializeToString()

    @staticmethod
    def modification(row):
        found = kv_query_result_pb2.KeyModification(tx_id=row.tx_id, value=row.value, is_delete=row.is_delete)
        found.timestamp.FromMilliseconds(row.timestamp_ms)
        return found.SerializeToString()


class FakePeer:
    """A stream to a contract service, with the peer's side of the protocol."""

    def __init__(self, call, state):
        self.stream = call
        self.state = state
        self.page = 2
        self.batch = (True, 1000)
        self.package_id = ""
        self.simulations: dict[tuple[str, str], Simulation] = {}
        self.busy: set[tuple[str, str]] = set()
        self.dropped = 0
        self.delay_s = 0.0
        self.keepalives = 0
        self.refuse = ""
        self.mute = False
        self.garbage = b""
        self.tasks: set[asyncio.Task[None]] = set()
        self.reader: asyncio.Task[None] | None = None
        self.lock = asyncio.Lock()

    async def send(self, message):
        async with self.lock:
            await self.stream.write(message if isinstance(message, bytes) else message.SerializeToString())

    async def receive(self):
        data = await asyncio.wait_for(self.stream.read(), 10)
        return None if data is grpc.aio.EOF else M.FromString(data)

    async def register(self):
        message = await self.receive()
        assert message.type == M.REGISTER
        self.package_id = chaincode_pb2.ChaincodeID.FromString(message.payload).name
        await self.send(M(type=M.REGISTERED))
        parameters = chaincode_pb2.ChaincodeAdditionalParams(
            use_write_batch=self.batch[0],
            max_size_write_batch=self.batch[1],
            use_get_multiple_keys=self.batch[0],
            max_size_get_multiple_keys=self.batch[1],
        )
        await self.send(M(type=M.READY, payload=parameters.SerializeToString()))
        self.reader = asyncio.create_task(self.read_all())
        return self

    async def read_all(self):
        while (data := await self.stream.read()) is not grpc.aio.EOF:
            message = M.FromString(data)
            if message.type == M.KEEPALIVE:
                self.keepalives += 1
                continue
            simulation = self.simulations[message.channel_id, message.txid]
            if message.type in {M.COMPLETED, M.ERROR}:
                simulation.answered.set_result(message)
                continue
            task = asyncio.create_task(self.answer(simulation, message))
            self.tasks.add(task)
            task.add_done_callback(self.tasks.discard)

    async def answer(self, simulation, message):
        key = message.channel_id, message.txid
        if key in self.busy:  # as Fabric's handler: "another request pending for this transaction"
            self.dropped += 1
            return
        self.busy.add(key)
        if self.delay_s:
            await asyncio.sleep(self.delay_s)
        answer = M(type=M.RESPONSE, txid=message.txid, channel_id=message.channel_id)
        if self.refuse == M.Type.Name(message.type):
            simulation.calls.append(self.refuse)
            answer.type, answer.payload = M.ERROR, f"{self.refuse} failed: no ledger context".encode()
        else:
            answer.payload = self.garbage or await simulation.answer(message)
        self.busy.discard(key)
        if not self.mute:
            await self.send(answer)

    async def begin(self, call, **change):
        simulation = Simulation(call, self.state, self.page)
        self.simulations[call.channel, call.tx_id] = simulation
        await self.send(call.message(**change))
        return simulation

    async def end(self, call, simulation):
        try:
            message = await asyncio.wait_for(asyncio.shield(simulation.answered), 10)
        finally:
            del self.simulations[call.channel, call.tx_id]
        status, text, payload = 0, "", b""
        if message.type == M.COMPLETED:
            response = proposal_response_pb2.Response.FromString(message.payload)
            status, text, payload = response.status, response.message, response.payload
        else:
            text = message.payload.decode()
        event = (
            (message.chaincode_event.event_name, message.chaincode_event.payload)
            if message.HasField("chaincode_event")
            else None
        )
        return Answered(message.type, status, text, payload, event, simulation.stub.result(), simulation.calls)

    async def run(self, call, **change):
        return await self.end(call, await self.begin(call, **change))

    async def run_message(self, call, message):
        simulation = self.simulations[call.channel, call.tx_id] = Simulation(call, self.state, self.page)
        await self.send(message)
        return await self.end(call, simulation)

    async def close(self):
        await self.stream.done_writing()
        if self.reader is not None:
            await asyncio.wait_for(self.reader, 10)


class NotAllowedError(Exception):
    def __init__(self, status, text):
        super().__init__(text)
        self.status = status


class ToyContract:
    """Every way to use the stub, and every way to misbehave."""

    version = "toy-1"
    functions = frozenset({"put", "get", "many", "crash"})

    def __init__(self):
        self.gate = asyncio.Event()
        self.entered = 0

    async def invoke(self, stub, function, args):
        texts = [each.decode() for each in args]
        return await getattr(self, f"do_{function}")(stub, *texts)

    async def do_put(self, stub, key, value, event=""):
        await stub.put(key, value.encode())
        if event:
            stub.set_event(event, value.encode())
        return value.encode()

    async def do_get(self, stub, key):
        value = await stub.get(key)
        return b"<none>" if value is None else value

    async def do_get_many(self, stub, *keys):
        values = await stub.get_many(keys)
        return json.dumps([None if value is None else value.decode() for value in values]).encode()

    async def do_guard(self, stub, key, *msp_ids):
        await stub.put(key, b"guarded")
        await stub.require_endorsement(key, msp_ids)
        await stub.put(f"{key}2", b"guarded, then gone")
        await stub.require_endorsement(f"{key}2", msp_ids)
        await stub.delete(f"{key}2")
        return b""

    async def do_guard_what_is_not_put(self, stub, key):
        await stub.require_endorsement(key, ["PadMSP"])

    async def do_put_then_get(self, stub, key, value):
        await stub.put(key, value.encode())
        return await self.do_get(stub, key)

    async def do_put_twice_then_delete_other(self, stub, key, other):
        await stub.put(key, b"first")
        await stub.put(key, b"second")
        await stub.put(other, b"x")
        await stub.delete(other)
        return b""

    async def do_range(self, stub, start, end):
        return json.dumps([[key, value.decode()] async for key, value in stub.range(start, end)]).encode()

    async def do_first(self, stub, start, end):
        """Reads the first key of a range, then goes on."""
        async for key, _ in stub.range(start, end):
            await stub.put("first", key.encode())
            return key.encode()
        return b""

    async def do_history(self, stub, key):
        return json.dumps(
            [[each.tx_id, each.timestamp_ms, each.value.decode(), each.is_delete] async for each in stub.history(key)]
        ).encode()

    async def do_fill(self, stub, prefix, count):
        for index in range(int(count)):
            await stub.put(f"{prefix}{index:05}", str(index).encode())
        return b""

    async def do_whoami(self, stub):
        creator = stub.creator
        return json.dumps(
            {
                "msp_id": creator.msp_id,
                "role": creator.role,
                "pol_id": creator.pol_id,
                "common_name": creator.common_name,
                "attributes": dict(creator.attributes),
                "certificate_sha256": creator.certificate_sha256,
                "public_key": creator.public_key.hex(),
                "node_ou": creator.node_ou,
                "channel": stub.channel,
                "tx_id": stub.tx_id,
                "timestamp_ms": stub.timestamp_ms,
            }
        ).encode()

    async def do_refuse(self, stub, status, text):
        await stub.put("k", b"never")
        stub.set_event("Never", b"x")
        raise NotAllowedError(int(status), text)

    async def do_crash(self, stub):
        await stub.put("k", b"never")
        return 1 // 0

    async def do_wait(self, stub):
        await asyncio.sleep(0)
        return b""

    async def do_sleep(self, stub):
        await asyncio.sleep(0.001)
        return b""

    async def do_two_at_once(self, stub):
        await asyncio.gather(stub.get("a"), stub.get("b"))
        return b""

    async def do_return_text(self, stub):
        return "not bytes"

    async def do_bad_key(self, stub, kind):
        keys = {"empty": "", "surrogate": "\ud800", "long": "k" * 4097, "bytes": b"k"}
        await stub.put(keys[kind], b"x")

    async def do_bad_value(self, stub, kind):
        values = {"empty": b"", "text": "x", "long": b"x" * (4 * 1024 * 1024 + 1)}
        await stub.put("k", values[kind])

    async def do_bad_event(self, stub, kind):
        events = {"empty": ("", b"x"), "text": ("E", "x"), "line": ("E\nF", b""), "long": ("E" * 257, b"")}
        stub.set_event(*events[kind])

    async def do_big_result(self, stub):
        return b"x" * (8 * 1024 * 1024 + 1)

    async def do_write_much(self, stub):
        for index in range(9):
            await stub.put(f"k{index}", b"x" * (1 << 20))
        return b""


class World:
    """A running contract service, and a way to dial it."""

    def __init__(self, server):
        self.server = server
        self.now_ms = START_MS
        self.channels: list[grpc.aio.Channel] = []

    def open_stream(self, credentials=None):
        options = [("grpc.max_receive_message_length", 100 << 20), ("grpc.max_send_message_length", 100 << 20)]
        if credentials is None:
            channel = grpc.aio.insecure_channel(self.server.address, options)
        else:
            channel = grpc.aio.secure_channel(self.server.address, credentials, options)
        self.channels.append(channel)
        return channel.stream_stream("/protos.Chaincode/Connect")()

    async def peer(self, state=None, credentials=None, **change):
        peer = FakePeer(self.open_stream(credentials), State() if state is None else state)
        for name, value in change.items():
            setattr(peer, name, value)
        return await peer.register()

    def count(self, name, **labels):
        wanted = f"wonderland_contract_{name}", labels
        for family in text_string_to_metric_families(self.server.metrics.exposition().decode()):
            for sample in family.samples:
                if (sample.name, sample.labels) == wanted:
                    return sample.value
        return 0.0


@asynccontextmanager
async def serving(contract, *, limits=None, tls=None, listen="127.0.0.1:0"):
    world: World | None = None
    server = ContractServer(
        contract,
        PACKAGE_ID,
        tls,
        limits or Limits(drain_s=1.0),
        Metrics(getattr(contract, "functions", ())),
        now_ms=lambda: START_MS if world is None else world.now_ms,
    )
    world = World(server)
    await server.start(listen)
    try:
        yield world
    finally:
        for channel in world.channels:
            await channel.close()
        await server.stop()


def in_place(contract, call, state):
    """The same transaction on the embedded ledger's endorser: (status, text, payload, event, read-write set)."""
    from wonderland_fabric_gateway.embedded.endorser import _run
    from wonderland_fabric_gateway.embedded.errors import ContractFailedError
    from wonderland_fabric_gateway.embedded.msp import Creator
    from wonderland_fabric_gateway.embedded.watchdog import Watchdog
    from wonderland_fabric_gateway.identity import Identity

    identity = Identity.from_creator(call.creator)
    names = ("msp_id", "role", "pol_id", "common_name", "attributes", "certificate_sha256", "node_ou")
    creator = Creator(**{name: getattr(identity, name) for name in names}, public_key=identity.public_key_bytes)
    stub = TransactionStub(
        state, "pol", channel=call.channel, tx_id=call.tx_id, timestamp_ms=call.timestamp_ms, creator=creator
    )
    proposal = types.SimpleNamespace(chaincode="pol", tx_id=call.tx_id)
    watchdog = Watchdog()
    function, *args = call.raw_args
    try:
        payload = _run(contract.invoke(stub, function.decode(), args), proposal, watchdog)
    except ContractFailedError as error:
        return error.status, str(error), b"", None, rwsets.ReadWriteSet()
    finally:
        watchdog.close()
    return 200, "", payload, stub.event, stub.result()


def key_and_certificate(name, issuer=None, *, days=30, start_days=-1, ca=False):
    """(key, certificate, key PEM, certificate PEM) for TLS on loopback."""
    import ipaddress

    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    issuer_key, issuer_name = (key, subject) if issuer is None else (issuer[0], issuer[1].subject)
    now = dt.datetime.now(dt.UTC)
    made = (
        x509.CertificateBuilder(
            issuer_name,
            subject,
            key.public_key(),
            x509.random_serial_number(),
            now + dt.timedelta(days=start_days),
            now + dt.timedelta(days=days),
        )
        .add_extension(x509.BasicConstraints(ca, None), critical=True)
        .add_extension(x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]), critical=False)
        .sign(issuer_key, hashes.SHA256())
    )
    pem = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    return key, made, pem, made.public_bytes(Encoding.PEM)
