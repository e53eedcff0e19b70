"""A running embedded ledger with a small contract, and the means to say untrue things to it."""

from __future__ import annotations

import asyncio
import atexit
import datetime as dt
import functools
import hashlib
import json
import os
import shutil
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from fabric_protos.common import common_pb2
from fabric_protos.gateway import gateway_pb2
from fabric_protos.orderer import ab_pb2
from fabric_protos.peer import chaincode_pb2, proposal_pb2

from wonderland_fabric_gateway.embedded.config_update import SigningIdentity
from wonderland_fabric_gateway.embedded.node import EmbeddedLedger, LedgerSettings
from wonderland_fabric_gateway.embedded.orderer import BatchLimits
from wonderland_fabric_gateway.gateway import Gateway


class NotAllowedError(Exception):
    """What a contract raises to refuse."""

    def __init__(self, status, text):
        super().__init__(text)
        self.status = status


class ToyContract:
    """Every way to use the stub, and every way to misbehave."""

    version = "toy-1"

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

    async def do_put_then_get(self, stub, key, value):
        await stub.put(key, value.encode())
        return await self.do_get(stub, key)

    async def do_delete(self, stub, key):
        await stub.delete(key)
        return b""

    async def do_increment(self, stub, key):
        value = int(await stub.get(key) or b"0") + 1
        await stub.put(key, str(value).encode())
        return str(value).encode()

    async def do_range(self, stub, start, end):
        return json.dumps({key: value.decode() async for key, value in stub.range(start, end)}).encode()

    async def do_count_into(self, stub, start, end, target):
        """Read a range, write how many keys it has."""
        count = len([key async for key, _ in stub.range(start, end)])
        await stub.put(target, str(count).encode())
        return str(count).encode()

    async def do_first_into(self, stub, start, end, target):
        """Read only the first key of a range."""
        async for key, _ in stub.range(start, end):
            await stub.put(target, key.encode())
            return key.encode()
        return b""

    async def do_fill(self, stub, prefix, count):
        for index in range(int(count)):
            await stub.put(f"{prefix}{index:05}", str(index).encode())
        return b""

    async def do_history(self, stub, key):
        return json.dumps(
            [[each.tx_id, each.timestamp_ms, each.value.decode(), each.is_delete] async for each in stub.history(key)]
        ).encode()

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

    async def do_guard(self, stub, key, msp_id):
        """A key that only this organisation's peers change from now on."""
        await stub.put(key, b"guarded")
        await stub.require_endorsement(key, [msp_id])
        return b""

    async def do_refuse(self, stub, status, text):
        raise NotAllowedError(int(status), text)

    async def do_crash(self, stub):
        return 1 // 0

    async def do_loop(self, stub, how="", key="k"):
        """Without an end; or with every trick against being ended."""
        await stub.get(key)
        while True:
            try:
                # Nothing of the stub's: a fast machine would reach the limits of a transaction before the time is up.
                sorted(key * 50)
            except Exception:
                if how != "stubborn":
                    raise

    async def do_wait(self, stub):
        await asyncio.sleep(0)
        return b""

    async def do_return_text(self, stub):
        return "not bytes"

    async def do_big(self, stub, count, size):
        for index in range(int(count)):
            await stub.put(f"big{index}", b"x" * int(size))
        return b""

    async def do_empty_key(self, stub):
        await stub.put("", b"x")


class Clock:
    """A clock that a test can move."""

    def __init__(self):
        self.offset = dt.timedelta()

    def __call__(self):
        return dt.datetime.now(dt.UTC) + self.offset


@dataclass
class World:
    """A running ledger, seen from outside."""

    ledger: EmbeddedLedger
    channel: object
    clock: Clock
    calls: dict = field(default_factory=dict)

    @property
    def connection(self):
        return self.ledger.connection

    @property
    def chain(self):
        return self.ledger.chain

    def gateway(self, name="pad"):
        return Gateway(self.channel, self.connection.identity(name), self.connection.signer(name))

    def network(self, name="pad"):
        return self.gateway(name).network(self.connection.channel)

    def contract(self, name="pad", chaincode="pol"):
        return self.network(name).contract(chaincode)

    def signing(self, name="pad"):
        return SigningIdentity(self.connection.identity(name), self.connection.signer(name))

    async def unary(self, method, request):
        """A call of gateway.Gateway with a message or raw bytes; returns the response's bytes."""
        data = request if isinstance(request, bytes) else request.SerializeToString()
        return await self.channel.preferred.unary_unary(f"/gateway.Gateway/{method}")(data, timeout=20)

    async def endorse(self, proposal, organisations=()):
        """The prepared transaction for a signed proposal."""
        request = gateway_pb2.EndorseRequest(
            channel_id=self.connection.channel,
            proposed_transaction=proposal.signed,
            endorsing_organizations=organisations,
        )
        return gateway_pb2.EndorseResponse.FromString(await self.unary("Endorse", request)).prepared_transaction

    async def submit(self, tx_id, envelope):
        request = gateway_pb2.SubmitRequest(
            transaction_id=tx_id, channel_id=self.connection.channel, prepared_transaction=envelope
        )
        await self.unary("Submit", request)

    async def status(self, tx_id, name="mirror"):
        """Validation code and block number."""
        who = self.signing(name)
        request = gateway_pb2.CommitStatusRequest(
            transaction_id=tx_id, channel_id=self.connection.channel, identity=who.creator
        ).SerializeToString()
        signed = gateway_pb2.SignedCommitStatusRequest(request=request, signature=who.sign(request))
        answer = gateway_pb2.CommitStatusResponse.FromString(await self.unary("CommitStatus", signed))
        return answer.result, answer.block_number

    def seek(self, who, start, stop=None, *, kind="Deliver", **more):
        """Open a block stream; returns the gRPC call."""
        return self.open_stream(kind, self.seek_envelope(who, start, stop, **more))

    def seek_envelope(self, who, start, stop=None, *, behavior=0, content=0, at=None):
        """A signed seek: positions are numbers, names of SeekPosition, or None for no end."""
        info = ab_pb2.SeekInfo(behavior=behavior, content_type=content)
        for position, number in ((info.start, start), (info.stop, stop)):
            if isinstance(number, int):
                position.specified.number = number
            elif number:
                getattr(position, number).SetInParent()
            else:
                position.specified.number = (1 << 63) - 1
        header = common_pb2.ChannelHeader(type=common_pb2.DELIVER_SEEK_INFO, channel_id=self.connection.channel)
        header.timestamp.FromDatetime((at or dt.datetime.now(dt.UTC)).replace(tzinfo=None))
        payload = common_pb2.Payload(
            header=common_pb2.Header(
                channel_header=header.SerializeToString(),
                signature_header=common_pb2.SignatureHeader(
                    creator=who.creator, nonce=os.urandom(24)
                ).SerializeToString(),
            ),
            data=info.SerializeToString(),
        ).SerializeToString()
        return common_pb2.Envelope(payload=payload, signature=who.sign(payload)).SerializeToString()

    def open_stream(self, kind, *messages):
        async def requests():
            for message in messages:
                yield message
            await asyncio.Event().wait()

        return self.channel.preferred.stream_stream(f"/protos.Deliver/{kind}")(requests(), timeout=20)


@dataclass
class SignedProposal:
    """A proposal made by hand, with everything in it open to change."""

    tx_id: str
    signed: object
    creator: bytes
    nonce: bytes


def make_proposal(who, *args, channel="wonderland", chaincode="pol", at=None, **change):
    """A signed proposal. `change` replaces nonce, tx_id, signature, sign, type, epoch, creator or header_chaincode."""
    nonce = change.get("nonce", os.urandom(24))
    creator = change.get("creator", who.creator)
    tx_id = change.get("tx_id", hashlib.sha256(nonce + creator).hexdigest())
    extension = proposal_pb2.ChaincodeHeaderExtension(
        chaincode_id=chaincode_pb2.ChaincodeID(name=change.get("header_chaincode", chaincode))
    )
    header = common_pb2.ChannelHeader(
        type=change.get("type", common_pb2.ENDORSER_TRANSACTION),
        channel_id=channel,
        tx_id=tx_id,
        epoch=change.get("epoch", 0),
        extension=extension.SerializeToString(),
    )
    if at is not False:
        header.timestamp.FromDatetime((at or dt.datetime.now(dt.UTC)).replace(tzinfo=None))
    spec = chaincode_pb2.ChaincodeInvocationSpec(
        chaincode_spec=chaincode_pb2.ChaincodeSpec(
            type=chaincode_pb2.ChaincodeSpec.GOLANG,
            chaincode_id=chaincode_pb2.ChaincodeID(name=chaincode),
            input=chaincode_pb2.ChaincodeInput(
                args=[each if isinstance(each, bytes) else each.encode() for each in args]
            ),
        )
    )
    data = proposal_pb2.Proposal(
        header=common_pb2.Header(
            channel_header=header.SerializeToString(),
            signature_header=common_pb2.SignatureHeader(creator=creator, nonce=nonce).SerializeToString(),
        ).SerializeToString(),
        payload=proposal_pb2.ChaincodeProposalPayload(
            input=spec.SerializeToString(), TransientMap=change.get("transient", {})
        ).SerializeToString(),
    ).SerializeToString()
    signature = change["signature"] if "signature" in change else change.get("sign", who.sign)(data)
    return SignedProposal(tx_id, proposal_pb2.SignedProposal(proposal_bytes=data, signature=signature), creator, nonce)


def high_s(signature):
    """The other valid form of an ECDSA signature, which Fabric refuses."""
    from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature, encode_dss_signature

    from wonderland_fabric_gateway.signing import P256_ORDER

    r, s = decode_dss_signature(signature)
    return encode_dss_signature(r, P256_ORDER - s)


@functools.cache
def _template():
    """Where a ledger is after its first start, to copy for each test: certificates are made once, not two hundred times."""
    directory = TemporaryDirectory(prefix="wonderland-ledger-")
    atexit.register(directory.cleanup)
    return Path(directory.name) / "ledger"


@asynccontextmanager
async def open_world(directory, *, first_start=False, **settings):
    """A ledger in `directory`. A new one is a copy, unless the first start itself is what is tested."""
    if not (first_start or directory.exists()):
        template = _template()
        if not template.exists():
            async with EmbeddedLedger(template, {"pol": ToyContract()}):
                pass
        shutil.copytree(template, directory)
    clock = settings.pop("clock", None) or Clock()
    settings.setdefault("limits", BatchLimits(time_ms=1))
    async with (
        EmbeddedLedger(directory, {"pol": ToyContract()}, LedgerSettings(clock=clock, **settings)) as ledger,
        ledger.connection.open_channel() as channel,
    ):
        yield World(ledger, channel, clock)
