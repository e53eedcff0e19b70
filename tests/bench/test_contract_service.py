"""The contract service under 100 000 transactions: memory, transactions per second, CPU time of each.

The service is a process of its own; the peer is a scripted one here, so that what is measured is the service alone.
Beside it an empty contract on the same service: what the proof-of-location contract itself costs is the difference.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import time

import grpc
import psutil
import pytest
from bench.bench_tools import show
from fabric_protos.ledger.queryresult import kv_query_result_pb2
from fabric_protos.peer import chaincode_pb2, proposal_response_pb2
from fabric_protos.peer import chaincode_shim_pb2 as shim
from kit import contract_peer as tools

from wonderland.proofs import encoding

TRANSACTIONS = 100_000
COMPARED = 10_000
AT_ONCE = 32
SAMPLES = 10
LIMIT_MIB = 60
M = shim.ChaincodeMessage
PACKAGE_ID = "pol_1.0:" + "cd" * 32
EMPTY = """
import asyncio, json
from wonderland_chaincode.service import ContractServer

class Empty:
    version = "empty"

    async def invoke(self, stub, function, args):
        return b""

async def main():
    server = ContractServer(Empty(), "pol_1.0:" + "cd" * 32)
    address = await server.start("127.0.0.1:0")
    print(json.dumps({"ready": True, "address": address}), flush=True)
    await asyncio.Event().wait()

asyncio.run(main())
"""

pytestmark = pytest.mark.bench


class LeanPeer:
    """Answers at once from a dictionary, and commits what succeeded; several transactions at a time."""

    def __init__(self, stream):
        self.stream = stream
        self.state = {}
        self.writes = {}
        self.waiting = {}
        self.statuses = {}
        self.lock = asyncio.Lock()

    async def open(self):
        assert M.FromString(await self.stream.read()).type == M.REGISTER
        await self.send(M(type=M.REGISTERED))
        offered = chaincode_pb2.ChaincodeAdditionalParams(
            use_write_batch=True, max_size_write_batch=1000, use_get_multiple_keys=True, max_size_get_multiple_keys=1000
        )
        await self.send(M(type=M.READY, payload=offered.SerializeToString()))
        self.reading = asyncio.create_task(self.read())
        return self

    async def send(self, message):
        async with self.lock:
            await self.stream.write(message.SerializeToString())

    async def read(self):
        while (data := await self.stream.read()) is not grpc.aio.EOF:
            message = M.FromString(data)
            if message.type == M.COMPLETED:
                response = proposal_response_pb2.Response.FromString(message.payload)
                self.statuses[response.status] = self.statuses.get(response.status, 0) + 1
                written = self.writes.pop(message.txid, {})
                if response.status == 200:
                    self.state.update(written)
                self.waiting.pop(message.txid).set_result(response)
                continue
            payload = self.answer(message)
            await self.send(M(type=M.RESPONSE, txid=message.txid, channel_id=message.channel_id, payload=payload))

    def answer(self, message):
        if message.type == M.GET_STATE:
            return self.state.get(shim.GetState.FromString(message.payload).key, b"")
        if message.type == M.GET_STATE_MULTIPLE:
            keys = shim.GetStateMultiple.FromString(message.payload).keys
            return shim.GetStateMultipleResult(values=[self.state.get(key, b"") for key in keys]).SerializeToString()
        writes = self.writes.setdefault(message.txid, {})
        if message.type == M.PUT_STATE:
            put = shim.PutState.FromString(message.payload)
            writes[put.key] = put.value
        elif message.type == M.WRITE_BATCH_STATE:
            writes.update({each.key: each.value for each in shim.WriteBatchState.FromString(message.payload).rec})
        else:
            assert message.type == M.GET_HISTORY_FOR_KEY, message.type
            key = shim.GetHistoryForKey.FromString(message.payload).key
            change = kv_query_result_pb2.KeyModification(tx_id="00" * 32, value=self.state.get(key, b""))
            change.timestamp.FromMilliseconds(int(time.time() * 1000))
            response = shim.QueryResponse(id="q")
            if key in self.state:
                for _ in range(5):
                    response.results.add(resultBytes=change.SerializeToString())
            return response.SerializeToString()
        return b""

    async def run(self, call):
        future = self.waiting[call.tx_id] = asyncio.get_running_loop().create_future()
        await self.send(call.message())
        return await future


def calls():
    """A day's mix without end: writes, reads, histories, refusals, and arguments that are none."""
    people = [tools.Person(f"person-{number}", number=number + 1) for number in range(50)]
    number = 0
    while True:
        number += 1
        who, asset = people[number % 50], f"asset-{number % 997}"
        body = {"id": asset}
        new = body | {"type": "std_msgs/msg/String", "media_type": "application/json", "value": "x" * 300}
        function, argument = (
            ("CreateAsset", new),
            ("ReadAsset", body),
            ("UpdateAsset", body | {"value": "y" * 300}),
            ("AssetHistory", body),
            ("ReadPad", {"pad_id": "nowhere"}),
            ("ReadPad", {"pad": number}),
            (f"NoSuch{number}", {}),
        )[number % 7]
        yield tools.Call(
            function, (encoding.encode(argument),), who=who, timestamp_ms=int(time.time() * 1000), nonce=os.urandom(24)
        )


async def drive(peer, source, count, each=None, every=0):
    """Seconds for so many transactions, ``AT_ONCE`` at a time."""
    left = iter(range(count))

    async def one_after_the_other():
        for number in left:
            await peer.run(next(source))
            if every and number % every == 0:
                each(number)

    started = time.perf_counter()
    await asyncio.gather(*(one_after_the_other() for _ in range(AT_ONCE)))
    return time.perf_counter() - started


async def dial(address, credentials=None):
    channel = grpc.aio.secure_channel(address, credentials) if credentials else grpc.aio.insecure_channel(address)
    return channel, await LeanPeer(channel.stream_stream("/protos.Chaincode/Connect")()).open()


def tls_files(directory):
    """Options for mutual TLS, and the credentials of a peer."""
    ca = tools.key_and_certificate("ca", ca=True)
    server, peer = (tools.key_and_certificate(name, ca) for name in ("service", "peer"))
    options = []
    for option, data in (("--tls-cert", server[3]), ("--tls-key", server[2]), ("--client-ca", ca[3])):
        path = directory / f"{option[2:]}.pem"
        path.write_bytes(data)
        options += [option, str(path)]
    return options, grpc.ssl_channel_credentials(ca[3], peer[2], peer[3])


async def test_memory_and_cost_of_a_hundred_thousand_transactions(processes, keep, tmp_path):
    arguments = ("chaincode", "serve", "--package-id", PACKAGE_ID, "--listen", "127.0.0.1:0", "--json")
    tls, credentials = tls_files(tmp_path)
    service = await processes.start("contract", *arguments, *tls, "--metrics", "127.0.0.1:0")
    watched = psutil.Process(service.handle.pid)
    channel, peer = await dial(service.ready["address"], credentials)
    source = calls()
    rows = []

    def sample(number):
        memory = watched.memory_full_info()
        rows.append((number, round(memory.rss / 2**20, 1), round(memory.uss / 2**20, 1)))

    sample(0)
    await drive(peer, source, COMPARED // 10)
    before = sum(watched.cpu_times()[:2])
    took_s = await drive(peer, source, TRANSACTIONS, sample, TRANSACTIONS // SAMPLES)
    sample(TRANSACTIONS)
    cpu_ms = (sum(watched.cpu_times()[:2]) - before) / TRANSACTIONS * 1000
    await channel.close()
    assert sum(peer.statuses.values()) == TRANSACTIONS + COMPARED // 10
    assert set(peer.statuses) == {200, 400, 404, 409}

    empty = await asyncio.create_subprocess_exec(sys.executable, "-c", EMPTY, stdout=asyncio.subprocess.PIPE)
    try:
        address = json.loads(await empty.stdout.readline())["address"]
        channel, peer = await dial(address)
        await drive(peer, source, COMPARED // 10)
        floor = psutil.Process(empty.pid)
        before = sum(floor.cpu_times()[:2])
        empty_s = await drive(peer, source, COMPARED)
        empty_ms = (sum(floor.cpu_times()[:2]) - before) / COMPARED * 1000
        await channel.close()
    finally:
        empty.terminate()
        await empty.wait()
        empty._transport.close()

    show("Memory of the contract service", ("transactions", "RSS MiB", "of its own MiB"), rows)
    show(
        "Each transaction",
        ("contract", "per s", "CPU ms"),
        [
            ("proof of location", round(TRANSACTIONS / took_s), round(cpu_ms, 3)),
            ("empty", round(COMPARED / empty_s), round(empty_ms, 3)),
        ],
    )
    growth = rows[-1][1] - rows[2][1]
    keep(
        rss_mib=rows[-1][1], uss_mib=rows[-1][2], growth_mib=round(growth, 1), per_s=round(TRANSACTIONS / took_s),
        cpu_ms=round(cpu_ms, 3), empty_cpu_ms=round(empty_ms, 3),
    )  # fmt: skip
    assert rows[-1][1] <= LIMIT_MIB
    assert growth < 2
