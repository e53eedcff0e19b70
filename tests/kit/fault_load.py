"""Proofs on a Fabric network while parts of it are killed, and the account of them afterwards.

Pads and drones use their own organisation's connection, as in life. A sender does what the agents do: it tries again
while the ledger is away, never what may have been sent. Three listeners go along: the contract's events, whole blocks,
and the backend's mirror.
"""

from __future__ import annotations

import asyncio
import collections
import contextlib
import itertools
import os
import signal
import time
from dataclasses import dataclass, field

from kit.proof_actors import Actors
from wonderland.proofs import encoding
from wonderland.proofs.records import transactions as tx
from wonderland_backend.db.engine import Database
from wonderland_backend.db.migrate import migrate
from wonderland_backend.mirror.follow import Mirror
from wonderland_backend.mirror.source import GatewaySource
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import CommitError, CommitUnknownError, EndorseError, Gateway
from wonderland_fabric_network import enrolment

PAD_COUNT = 2
DRONE_COUNT = 4


@dataclass
class Account:
    """What the senders know: transactions by their end, proofs by time."""

    valid: dict[str, str] = field(default_factory=dict)
    """Transaction id → function, as acknowledged."""
    invalid: set[str] = field(default_factory=set)
    unknown: set[str] = field(default_factory=set)
    granted: dict[str, str] = field(default_factory=dict)
    """Session → transaction of its verdict."""
    proofs_s: list[float] = field(default_factory=list)
    """When each verdict was known, by the monotonic clock."""
    tries: int = 0
    refusals: collections.Counter = field(default_factory=collections.Counter)


@dataclass(frozen=True)
class Audit:
    """What the chain says about an account."""

    lost: int
    duplicated: int
    unresolved: int
    unfounded: int
    """Permissions that a sender acted on without a VALID verdict on the chain."""
    valid_on_chain: int
    repeated_ids: int
    """Transactions that stand a second time, DUPLICATE_TXID."""


class FaultActors(Actors):
    """Pads and drones, each by its own organisation's peers."""

    def __init__(self, network, stack):
        super().__init__(None, None)
        self._network = network
        self._stack = stack
        self._connections = {}

    async def open(self):
        """Channels to each organisation's peers."""
        for organisation in self._network.organisations:
            connection = Connection.load(self._network.directory.organisation(organisation.msp_id).connection_file)
            channel = await self._stack.enter_async_context(connection.open_channel())
            for name in connection.identities:
                self._connections[name] = (connection, channel)

    def contract(self, name):
        if name not in self._contracts:
            connection, channel = self._connections[name]
            self.signers[name] = connection.signer(name)
            gateway = Gateway(channel, connection.identity(name), self.signers[name])
            self._contracts[name] = gateway.network(connection.channel).contract(connection.chaincode)
        return self._contracts[name]

    def gateway_network(self, name):
        """The channel, as that identity."""
        connection, channel = self._connections[name]
        gateway = Gateway(channel, connection.identity(name), connection.signer(name))
        return gateway.network(connection.channel)


class FaultLoad:
    """Proofs without end, until told to stop."""

    def __init__(self, actors, account):
        self.actors = actors
        self.account = account
        self._stopping = False

    async def sure(self, name, function, argument):
        """Submit as agents do; None where the outcome stays unknown or it is invalid."""
        while True:
            self.account.tries += 1
            try:
                done = await self.actors.contract(name).submit_with_retry(function, argument.encode())
            except EndorseError as error:
                if error.chaincode_response is not None:
                    self.account.refusals[error.chaincode_response.message.partition(":")[0]] += 1
                    if error.chaincode_response.status != 404:
                        return None
                await asyncio.sleep(0.05)
            except CommitUnknownError as error:
                self.account.unknown.add(error.tx_id)
                return None
            except CommitError as error:
                self.account.invalid.add(error.tx_id)
                return None
            else:
                self.account.valid[done.tx_id] = function
                return done

    async def prove(self, prepared, number):
        """One proof, through whatever happens."""
        request = self.actors.request(prepared, time.time_ns() // 1_000_000)
        requested = await self.sure(prepared.uav_id, "RequestProof", request)
        if requested is None:
            return
        argument = self.actors.proof(prepared, number, request.claim.t_ms, requested)
        done = await self.sure(prepared.pad_id, "SubmitProof", argument)
        if done is None:
            return
        self.account.proofs_s.append(time.monotonic())
        if encoding.decode(done.payload)["permission"] == "granted":
            self.account.granted[requested.tx_id] = done.tx_id

    async def run(self, prepared, at_once):
        """Prove one after the other, `at_once` side by side, until `stop`."""
        waiting = iter(enumerate(prepared))

        async def work():
            for number, each in waiting:
                if self._stopping:
                    return
                await self.prove(each, number)
            raise AssertionError("too few prekeys were prepared for this run")

        await asyncio.gather(*(work() for _ in range(at_once)))

    async def last(self):
        """One more transaction with an event, after all others; its id."""
        pad_id = f"last-{len(self.account.valid)}"
        place = {"lat_e7": 604_518_000, "lon_e7": 222_666_000, "height_mm": 30_000}
        argument = tx.RegisterPad(pad_id=pad_id, name=pad_id, operator_id="bench", **place)
        return (await self.sure("pad_operator", "RegisterPad", argument)).tx_id

    def stop(self):
        """Let what is under way come to its end."""
        self._stopping = True


class Listeners:
    """Events, blocks and a mirrored database, for as long as the load lasts."""

    def __init__(self, network, database):
        self._network = network
        self.database = database
        self.events = []
        self.blocks = []
        self.status = MirrorStatus()
        self._tasks = []

    async def start(self, start_block):
        mirror = Mirror(
            self.database,
            GatewaySource(self._network),
            channel=self._network.name,
            chaincode="pol",
            status=self.status,
            clock=lambda: time.time_ns() // 1_000_000,
        )

        async def hear():
            async with self._network.chaincode_events("pol", start_block=start_block, reconnect=True) as stream:
                async for event in stream:
                    self.events.append((event.block_number, event.tx_id, event.name))

        async def read():
            async with self._network.blocks(start_block=start_block, reconnect=True) as stream:
                async for block in stream:
                    self.blocks.append(block)

        self._tasks = [asyncio.create_task(each) for each in (hear(), read(), mirror.run())]

    async def reach(self, tx_id):
        """Until all three have the block of that transaction, which must have set an event."""
        height = (await self._network.commit(tx_id).status()).block_number + 1
        async with asyncio.timeout(60):
            while True:
                for task in self._tasks:
                    if task.done():
                        task.result()
                assert self.status.halted is None, self.status.halted
                seen = (
                    self.events[-1][0] + 1 if self.events else 0,
                    self.blocks[-1].number + 1 if self.blocks else 0,
                    self.status.mirrored,
                )
                if min(seen) >= height:
                    return
                await asyncio.sleep(0.05)

    async def close(self):
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)


@contextlib.asynccontextmanager
async def faulty(network, directory, proofs):
    """Registered pads and drones, prekeys for so many proofs, listeners; yields (load, listeners, prepared)."""
    requests = [enrolment.Request(f"pad-{index}", "pad", f"pad-{index}") for index in range(PAD_COUNT)]
    requests += [enrolment.Request(f"uav-{index}", "uav", f"uav-{index}") for index in range(DRONE_COUNT)]
    await enrolment.enrol(network, requests)
    async with contextlib.AsyncExitStack() as stack:
        actors = FaultActors(network, stack)
        await actors.open()
        await actors.register(time.time_ns() // 1_000_000, pads=PAD_COUNT, drones=DRONE_COUNT)
        prepared = await actors.prepare(proofs, pads=PAD_COUNT, drones=DRONE_COUNT)
        seen_by_mirror = actors.gateway_network("mirror")
        start = await seen_by_mirror.height()
        database = Database(f"sqlite:///{directory / 'mirror.db'}")
        await migrate(database)
        listeners = Listeners(seen_by_mirror, database)
        try:
            await listeners.start(start)
            yield FaultLoad(actors, Account()), listeners, prepared
        finally:
            await listeners.close()
            await database.close()


def stall_s(proofs_s, since_s, until_s):
    """The longest time without a new verdict between two moments of the monotonic clock."""
    times = [since_s, *(each for each in proofs_s if since_s < each < until_s), until_s]
    return max(later - earlier for earlier, later in itertools.pairwise(times))


async def proofs_after(account, count, *, patience_s=90.0):
    """Until so many more verdicts are known than now."""
    wanted = len(account.proofs_s) + count
    async with asyncio.timeout(patience_s):
        while len(account.proofs_s) < wanted:
            await asyncio.sleep(0.02)


async def kill(network, component):
    """kill −9, and wait until it has ended."""
    os.kill(network.processes.pid(component), signal.SIGKILL)
    while network.processes.pid(component) is not None:
        await asyncio.sleep(0.01)


def audit(account, blocks):
    """Compare an account with the chain."""
    codes = {}
    effects = collections.Counter()
    repeated = 0
    decided = set()
    for block in blocks:
        for transaction in block.transactions:
            code = transaction.validation_code
            if code == 9:
                repeated += 1
                continue
            codes.setdefault(transaction.tx_id, []).append(code)
            if code == 0 and transaction.invocation is not None:
                function = transaction.invocation.function
                argument = encoding.decode(transaction.invocation.args[1])
                if function == "RequestProof":
                    effects[function, argument["pad_id"], argument["prekey_id"]] += 1
                elif function == "SubmitProof":
                    effects[function, argument["session_id"]] += 1
                    decided.add((argument["session_id"], transaction.tx_id))
    return Audit(
        lost=sum(0 not in codes.get(tx_id, []) for tx_id in account.valid),
        duplicated=sum(count - 1 for count in effects.values()) + sum(len(each) - 1 for each in codes.values()),
        unresolved=sum(tx_id not in codes for tx_id in account.unknown),
        unfounded=sum(each not in decided for each in account.granted.items()),
        valid_on_chain=sum(0 in each for each in codes.values()),
        repeated_ids=repeated,
    )
