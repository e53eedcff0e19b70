"""Two ledgers with one face, and the people who use them: what the scenarios are told with.

Both have the same organisations: the authority, two operators of pads (PadMSP, Pad2MSP) and a fleet. Nothing here
reaches into a ledger: all of it goes by connection.json and the Gateway, as it does for anybody else.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import time

import psutil
import pytest

from kit.contract import Scene
from kit.every_peer import every_peer
from wonderland.proofs import encoding
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration
from wonderland_fabric_gateway.embedded.directory import LedgerDirectory
from wonderland_fabric_gateway.gateway import EndorseError, EvaluateError, Gateway
from wonderland_fabric_gateway.signing import raw_from_der
from wonderland_fabric_network import binaries as servers
from wonderland_fabric_network import bringing_up, enrolment, revocations, taking_down
from wonderland_fabric_network.description import NetworkDescription, Organisation, standard_endorsement
from wonderland_fabric_network.layout import NetworkDirectory

PATIENCE_S = 60
"""For what comes soon, on a machine that is busy with other tests."""


def quiet(_step, _text):
    """Nobody listens."""


# --- the ledgers


class EmbeddedPlace:
    """The embedded ledger as its command runs it, in a process of its own."""

    kind = "embedded"

    def __init__(self, directory):
        self.directory = directory / "ledger"
        self.connection_file = self.directory / "connection.json"
        self.log = directory / "ledger.log"
        self._process = None

    def start(self):
        command = [sys.executable, "-m", "wonderland.cli", "ledger", "start", "--json", "--listen", "127.0.0.1:0"]
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                [*command, "--data", str(self.directory), "--pad-operator", "Pad2MSP"],
                stdout=subprocess.PIPE,
                stderr=log,
            )
        ready, _, _ = select.select([self._process.stdout], [], [], PATIENCE_S)
        line = self._process.stdout.readline() if ready else b""
        assert line, f"the ledger did not start: {self.log.read_text()}"
        assert json.loads(line)["ready"] is True

    def stop(self):
        self._end(signal.SIGTERM)

    def crash(self):
        """Kill −9, and start again."""
        self._end(signal.SIGKILL)
        self.start()

    def _end(self, number):
        process, self._process = self._process, None
        if process is not None:
            process.send_signal(number)
            process.wait(PATIENCE_S)
            process.stdout.close()

    async def enrol(self, name, role, pol_id, msp_id):
        administration = DirectoryAdministration(LedgerDirectory(self.directory))
        await asyncio.to_thread(administration.enrol, name, role=role, pol_id=pol_id, msp_id=msp_id)

    async def revoke(self, name):
        await DirectoryAdministration(LedgerDirectory(self.directory)).revoke(name)

    def gateways(self):
        """The connection of each place where blocks are kept."""
        return [Connection.load(self.connection_file)]


class FabricPlace:
    """A network of Fabric's servers: an orderer, four peers, three contract servers."""

    kind = "fabric"

    def __init__(self, directory, consensus="raft"):
        self.directory = NetworkDirectory(directory / "net")
        self.connection_file = self.directory.connection_file
        standard = NetworkDescription()
        organisations = (*standard.organisations, Organisation(msp_id="Pad2MSP", kind="pads"))
        self._description = standard.with_organisation(organisations[-1]).with_endorsement(
            standard_endorsement(organisations)
        )
        if consensus != "raft":
            self._description = self._description.with_ordering(consensus)
        self._network = None

    @property
    def network(self):
        """What the network's own tools take."""
        return self._network

    def start(self):
        if self._network is None:
            self._network = bringing_up.new_network(self.directory, self._description)
        asyncio.run(self._up())

    async def _up(self):
        await bringing_up.bring_up(self._network, await servers.check_binaries(), quiet)

    def stop(self):
        if self._network is not None:
            asyncio.run(taking_down.take_down(self._network, quiet))

    def crash(self):
        """Kill −9 of every orderer, peer and contract server, and start again."""
        processes = self._network.processes
        pids = [processes.pid(name) for name in processes.names() if not name.endswith(".ca")]
        for pid in filter(None, pids):
            os.kill(pid, signal.SIGKILL)
        for pid in filter(None, pids):
            with contextlib.suppress(psutil.NoSuchProcess):
                psutil.Process(pid).wait(PATIENCE_S)
        self.start()

    async def enrol(self, name, role, pol_id, msp_id):
        await enrolment.enrol(self._network, [enrolment.Request(name, role, pol_id, msp_id)])

    async def revoke(self, name):
        await revocations.revoke(
            self._network, Connection.load(self.connection_file).identities[name].msp_id, name=name
        )

    def gateways(self):
        """One per organisation: each has its own peer."""
        directories = [self.directory.organisation(each.msp_id) for each in self._description.organisations]
        return [Connection.load(each.connection_file) for each in directories]


PLACES = {place.kind: place for place in (EmbeddedPlace, FabricPlace)}


# --- the people


def also_with_the_node_client(test):
    """Marks a scenario that the official Node client plays, too."""
    test.also_with_the_node_client = True
    return test


class Person:
    """Somebody with a certificate, at the contract."""

    def __init__(self, people, name):
        self.people = people
        self.name = name
        connection = people.connection
        self.identity = connection.identity(name)
        self._sign = connection.signer(name)
        self.gateway = Gateway(people.channel, self.identity, self._sign, now_ns=people.now_ns)
        self.network = self.gateway.network(connection.channel)
        self.contract = self.network.contract(connection.chaincode)

    def sign(self, message):
        """Raw signature (r ‖ s), as the drone gives it in step 6."""
        return raw_from_der(self._sign(message))

    async def submit(self, function, argument=None, /, *, endorsed_by=(), **fields):
        """Submit and have it VALID: the contract's answer."""
        return (await self.submitted(function, argument, endorsed_by=endorsed_by, **fields))[1]

    async def submitted(self, function, argument=None, /, *, endorsed_by=(), **fields):
        """Submit and have it VALID: what the Gateway says of it, and the contract's answer."""
        text = encoding.encode({**(argument or {}), **fields})
        if endorsed_by:
            done = await self.contract.submit(function, text, endorsing_organizations=endorsed_by)
        else:
            done = await self.contract.submit_with_retry(function, text)
        await self.people.everywhere(done.block_number)
        return done, encoding.decode(done.payload)

    async def query(self, function, argument=None, /, **fields):
        """Ask without recording anything."""
        text = encoding.encode({**(argument or {}), **fields})
        return encoding.decode(await self.contract.evaluate(function, text), max_bytes=8 << 20)

    async def endorsed(self, function, argument=None, /, *, endorsed_by=(), **fields):
        """A transaction that is endorsed and not yet submitted."""
        text = encoding.encode({**(argument or {}), **fields})
        return await self.contract.propose(function, text, endorsing_organizations=endorsed_by).endorse()

    async def is_refused(self, status, code, function, argument=None, /, **fields):
        """The contract refuses, with this status and code; returns its text."""
        with pytest.raises(EndorseError) as raised:
            await self.endorsed(function, argument, **fields)
        response = raised.value.chaincode_response
        assert response is not None, raised.value
        found, _, text = response.message.partition(": ")
        assert (response.status, found) == (status, code), response
        return text

    async def finds_nothing(self, function, **fields):
        """A query that the contract answers with 404."""
        with pytest.raises(EvaluateError) as raised:
            await self.query(function, **fields)
        assert raised.value.chaincode_response.status == 404


class People:
    """Everybody, over one connection. Their clocks stand a minute behind, so that a test can let time pass at once."""

    person = Person

    def __init__(self, place, connection, channel, everywhere):
        self.place = place
        self.connection = connection
        self.channel = channel
        self.everywhere = everywhere
        self._known = {}
        self.behind_ms = 60_000

    def __getitem__(self, name):
        if name not in self._known:
            self._known[name] = self.person(self, name)
        return self._known[name]

    @property
    def now_ms(self):
        return time.time_ns() // 1_000_000 - self.behind_ms

    def now_ns(self):
        return time.time_ns() - self.behind_ms * 1_000_000

    def later(self, ms):
        """So much time passes for everybody."""
        assert ms <= self.behind_ms
        self.behind_ms -= ms

    async def enrol(self, role, pol_id, msp_id=None):
        """A new identity; its name is its id."""
        await self.place.enrol(pol_id, role, pol_id, msp_id)
        self.connection = Connection.load(self.place.connection_file)
        return self[pol_id]

    async def block(self, number):
        async with self["mirror"].network.blocks(start_block=number) as stream:
            return await anext(aiter(stream))

    async def endorsers(self, done):
        """The organisations that signed a transaction."""
        (transaction,) = [
            each for each in (await self.block(done.block_number)).transactions if each.tx_id == done.tx_id
        ]
        return {each.msp_id for each in transaction.endorsers}

    async def outcomes(self, transactions):
        """Submit them all at once: the names of their validation codes."""
        commits = await asyncio.gather(*(each.submit() for each in transactions))
        statuses = await asyncio.gather(*(each.status() for each in commits))
        await self.everywhere(max(each.block_number for each in statuses))
        return [each.code_name for each in statuses]


@contextlib.asynccontextmanager
async def people_at(place, kind=People):
    """The people of a ledger that runs."""
    connection = Connection.load(place.connection_file)
    async with every_peer(place.gateways()) as everywhere, connection.open_channel() as channel:
        yield kind(place, connection, channel, everywhere)


# --- the place of the story


class Site:
    """A pad that is surveyed, with prekeys, and a drone that may land there. Everything new, named after `tag`."""

    def __init__(self, people, tag, pad_msp_id):
        self.people = people
        self.pad_id, self.uav_id = f"pad-{tag}", f"uav-{tag}"
        self.pad_msp_id = pad_msp_id
        self.operator = people["pad_operator" if pad_msp_id == "PadMSP" else f"pad_operator@{pad_msp_id}"]
        self.admin, self.fleet, self.mirror = (people[name] for name in ("admin", "fleet_operator", "mirror"))
        self.pad = self.uav = None
        self._prekeys = 0

    async def ready(self, *, authorised=True, survey=None):
        people = self.people
        self.pad = await people.enrol("pad", self.pad_id, self.pad_msp_id)
        self.uav = await people.enrol("uav", self.uav_id)
        valid = {"valid_from_ms": people.now_ms - 60_000, "valid_until_ms": people.now_ms + 10**10}
        scene = self.scene()
        await self.operator.submit("RegisterPad", scene.pad_argument(self.pad_id))
        commissioning = scene.commissioning(**valid, **(survey or {}))
        await self.operator.submit("CommissionPad", pad_id=self.pad_id, commissioning=commissioning)
        await self.offer()
        await self.fleet.submit("RegisterUav", scene.uav_argument(self.uav_id))
        maintenance = {"performed_ms": people.now_ms - 60_000, "valid_until_ms": valid["valid_until_ms"]}
        await self.fleet.submit("RecordMaintenance", scene.maintenance(uav_id=self.uav_id, **maintenance))
        if authorised:
            grant = scene.authorisation(uav_id=self.uav_id, pad_id=self.pad_id, **valid)
            await self.admin.submit("GrantAuthorisation", grant)
        return self

    async def set_policy(self, policy, action="*"):
        """By two people."""
        proposed = await self.admin.submit("ProposePolicy", pad_id=self.pad_id, action=action, policy=policy)
        return await self.people["inspector"].submit("ApproveChange", Scene.approval(proposed))

    def scene(self):
        """The contract tests' scene at the people's time, for its records."""
        scene = Scene()
        scene.now_ms = self.people.now_ms
        return scene

    async def offer(self, count=3):
        """The pad publishes prekeys: k0, k1, k2 …"""
        names = [f"k{self._prekeys + index}" for index in range(count)]
        self._prekeys += count
        offered = [{"prekey_id": name, "public_key": Scene.point(50 + int(name[1:]))} for name in names]
        await self.pad.submit("PublishPrekeys", pad_id=self.pad_id, prekeys=offered)

    async def offer_until(self, count):
        """So many prekeys wait, if none was used but k0."""
        while (missing := count + 1 - self._prekeys) > 0:
            await self.offer(min(missing, 100))

    def wish(self, prekey_id="k0"):
        """What the drone asks."""
        return self.scene().request_argument(prekey_id, pad_id=self.pad_id)

    async def request(self, prekey_id="k0"):
        return await self.uav.submit("RequestProof", self.wish(prekey_id))

    def evidence(self, session, **more):
        """What the pad measured, while two seconds and a half passed."""
        evidence = self.scene().evidence(session, signer=self.uav, **more)
        self.people.later(2_500)
        return evidence

    async def judge(self, session, **more):
        return await self.pad.submit(
            "SubmitProof", session_id=session["session_id"], evidence=self.evidence(session, **more)
        )
