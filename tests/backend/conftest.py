"""A ledger made of valid blocks without a ledger, databases of both kinds, and backends that run on them."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import hashlib
import json
import os
import pwd
import shutil
import subprocess
from dataclasses import dataclass, field, replace
from pathlib import Path

import httpx
import pytest
import websockets
from cryptography.hazmat.primitives.serialization import load_pem_private_key
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
from wonderland.proofs.records import assets, keys, pads, policies, sessions, uavs, verdicts
from wonderland.telemetry import signed_text
from wonderland_backend.app import Backend
from wonderland_backend.db.engine import Database
from wonderland_backend.db.migrate import migrate
from wonderland_backend.serve import Listen, new_server
from wonderland_backend.settings import Settings
from wonderland_fabric_gateway.blocks import BlockHeader, data_hash, parse_block
from wonderland_fabric_gateway.ca.local import LocalCa
from wonderland_fabric_gateway.embedded.genesis import ChannelDescription, OrganisationDescription, genesis_block
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.signing import key_signer

START_MS = 1_800_000_000_000
MSPS = ("AuthorityMSP", "PadMSP", "FleetMSP")
FRAME = {
    "lat_e7": 604_518_000,
    "lon_e7": 222_666_000,
    "height_mm": 30_000,
    "e1": 23_627_000_000,
    "e2": -92_000_000,
    "e3": 3_700_000,
    "n1": 47_900_000_000,
    "n2": 0,
    "n3": 40_000_000,
    "n4": 7_800_000,
    "u2": -87_000_000,
    "u3": -21_000_000,
}


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
            return OrganisationDescription(msp_id, self.cas[msp_id].root_pem(), self.cas[msp_id].root_pem())

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


class Facts:
    """Records as the contract stores them, and the transactions that store them. Every one is a valid record."""

    @staticmethod
    def pad(pad_id="pad-1", *, commissioned=True, **more):
        anchors = [
            {
                "anchor_id": f"A{index}",
                "mac": 0xA000 + index,
                "east_mm": east,
                "north_mm": north,
                "up_mm": 200,
                "survey_sigma_mm": 3,
                "bias": [{"range_mm": 0, "bias_mm": 0, "sigma_mm": 5}],
            }
            for index, (east, north) in enumerate(((1500, 1500), (-1500, 1500), (-1500, -1500), (1500, -1500)))
        ]
        record = {
            "pad_id": pad_id,
            "name": "Aurajoki 2",
            "operator_id": "turku",
            "msp_id": "PadMSP",
            "status": "commissioned" if commissioned else "registered",
            "lat_e7": FRAME["lat_e7"],
            "lon_e7": FRAME["lon_e7"],
            "height_mm": 30_000,
            "registered_ms": START_MS,
            "updated_ms": START_MS,
        }
        if commissioned:
            commissioning = {
                "frame": FRAME,
                "anchors": anchors,
                "range_sigma_mm": 25,
                "installation_sigma_mm": 5,
                "max_range_mm": 100_000,
                "valid_from_ms": 0,
                "valid_until_ms": 2 * START_MS,
                "method": "simulated",
            }
            digest = encoding.digest(commissioning).hex()
            record |= {"commissioning": commissioning, "commissioning_sha256": digest}
        return pads.Pad.parse(record | more)

    @staticmethod
    def uav(uav_id="uav-1", **more):
        record = {
            "uav_id": uav_id,
            "operator_id": "fleet",
            "msp_id": "FleetMSP",
            "registration": "FIN87astrdge12k8",
            "model": "M300",
            "status": "active",
            "registered_ms": START_MS,
            "updated_ms": START_MS,
        }
        return uavs.Uav.parse(record | more)

    @staticmethod
    def authorisation(uav_id="uav-1", authorisation_id="a1", **more):
        record = {
            "authorisation_id": authorisation_id,
            "uav_id": uav_id,
            "pad_id": "*",
            "actions": ["land"],
            "valid_from_ms": 0,
            "valid_until_ms": 2 * START_MS,
            "granted_by": "inspector",
            "granted_ms": START_MS,
            "revoked": False,
        }
        return uavs.Authorisation.parse(record | more)

    @staticmethod
    def claim(**more):
        record = {
            "lat_e7": FRAME["lat_e7"] + 900,
            "lon_e7": FRAME["lon_e7"],
            "height_mm": 42_000,
            "accuracy_mm": 900,
            "height_accuracy_mm": 1_500,
            "t_ms": START_MS,
        }
        return record | more

    def session(self, session_id, pad_id="pad-1", uav_id="uav-1", t_ms=START_MS, **more):
        party = {"msp_id": "PadMSP", "certificate_sha256": "0" * 64, "public_key": "A" * 87}
        record = {
            "session_id": session_id,
            "state": "requested",
            "pad_id": pad_id,
            "uav_id": uav_id,
            "action": "land",
            "claim": self.claim(),
            "prekey_id": "k1",
            "pad_key": "A" * 87,
            "uav_key": "A" * 87,
            "pad": party,
            "uav": party,
            "commissioning_sha256": "0" * 64,
            "transcript_sha256": "0" * 64,
            "contract_version": "1",
            "policy": policies.Policy().to_json(),
            "requested_ms": t_ms,
            "expires_ms": t_ms + 60_000,
        }
        return sessions.Session.parse(record | more)

    @staticmethod
    def evidence(t_ms=START_MS, rounds=3):
        times = [t_ms + 50 * index for index in range(rounds)]
        record = {
            "ranges": {
                "t_ms": times,
                "anchors": [
                    {"anchor_id": f"A{index}", "range_mm": [4_000 + index] * rounds, "nlos": []} for index in range(4)
                ],
            },
            "claims": [],
            "broadcast": [],
            "matched": "both",
            "radio": {"measured_by": "pad", "sts": "provisioned"},
            "steps": [{"step": "poll", "t_ms": t_ms + 10}, {"step": "range", "t_ms": t_ms + 20}],
        }
        return sessions.Evidence.parse(record)

    @staticmethod
    def verdict(session_id, pad_id="pad-1", uav_id="uav-1", t_ms=START_MS, outcome="verified", **more):
        position = {
            "east_mm": 100,
            "north_mm": 1_000,
            "up_mm": 12_000,
            "lat_e7": FRAME["lat_e7"] + 900,
            "lon_e7": FRAME["lon_e7"],
            "height_mm": 42_000,
        }
        judgement = {
            "outcome": outcome,
            "claim": position,
            "error_mm": 120,
            "likelihood_ppm": 999_000,
            "paper_rule": True,
            "reasons": [{"code": "within_buffer", "facts": {"error_mm": 120, "buffer_mm": 1_000}}],
        }
        record = {
            "session_id": session_id,
            "pad_id": pad_id,
            "uav_id": uav_id,
            "action": "land",
            "outcome": outcome,
            "permission": "granted" if outcome == "verified" else "refused",
            "authorised": True,
            "assurance": 2,
            "rounds": 24,
            "buffer_mm": 1_000,
            "decided_ms": t_ms,
            "evidence_sha256": "0" * 64,
            "reasons": [],
            "more_rounds": 0,
            "signed": judgement,
            "estimate": position,
            "covariance": {"ee_mm2": 100, "en_mm2": 5, "nn_mm2": 90},
        }
        return verdicts.Verdict.parse(record | more)

    @staticmethod
    def asset(asset_id="thing", value="a\u0000b", **more):
        record = {
            "id": asset_id,
            "type": "geometry_msgs/msg/PoseStamped",
            "media_type": "text/plain",
            "value": value,
            "owner_msp": "PadMSP",
            "owner": "pad-1",
            "version": 1,
            "created_ms": START_MS,
            "updated_ms": START_MS,
        }
        return assets.Asset.parse(record | more)

    def put_pad(self, pad_id="pad-1", **more):
        pad = self.pad(pad_id, **more)
        return Tx("CommissionPad", {"pad_id": pad_id}, {keys.composite(keys.PAD, pad_id): pad.encode()})

    def put_uav(self, uav_id="uav-1", **more):
        uav = self.uav(uav_id, **more)
        return Tx("RegisterUav", {"uav_id": uav_id}, {keys.composite(keys.UAV, uav_id): uav.encode()})

    def grant(self, uav_id="uav-1", authorisation_id="a1"):
        record = self.authorisation(uav_id, authorisation_id)
        key = keys.composite(keys.AUTHORISATION, uav_id, authorisation_id)
        return Tx("GrantAuthorisation", {"uav_id": uav_id}, {key: record.encode()})

    def set_policy(self, pad_id="*", action="*"):
        key = keys.composite(keys.POLICY, pad_id, action)
        return Tx("SetPolicy", {}, {key: policies.Policy(buffer_mm=2_000).encode()})

    def request(self, name, pad_id="pad-1", uav_id="uav-1", t_ms=START_MS):
        session_id = number("session", name)
        record = self.session(session_id, pad_id, uav_id, t_ms)
        event = ("ProofRequested", encoding.encode({"kind": "ProofRequested", "record": record.to_json()}))
        used = encoding.encode({"session_id": session_id})
        writes = {
            keys.composite(keys.SESSION, session_id): record.encode(),
            keys.composite(keys.PREKEY, pad_id, "k1"): None,
            keys.composite(keys.USED_PREKEY, pad_id, "k1"): used,
        }
        return Tx("RequestProof", {"pad_id": pad_id}, writes, event, t_ms=t_ms, tx_id=session_id)

    def decide(self, name, pad_id="pad-1", uav_id="uav-1", t_ms=START_MS, outcome="verified", rounds=3):
        session_id = number("session", name)
        record = self.session(session_id, pad_id, uav_id, t_ms, state="decided", decided_ms=t_ms + 2_000)
        verdict = self.verdict(session_id, pad_id, uav_id, t_ms + 2_000, outcome)
        event = ("ProofDecided", encoding.encode({"kind": "ProofDecided", "record": verdict.to_json()}))
        evidence = self.evidence(t_ms, rounds)
        argument = {"session_id": session_id, "evidence": evidence.to_json()}
        writes = {
            keys.composite(keys.SESSION, session_id): record.encode(),
            keys.composite(keys.VERDICT, session_id): verdict.encode(),
        }
        return Tx("SubmitProof", argument, writes, event, t_ms=t_ms + 2_000)

    @staticmethod
    def judged(session, evidence=None, verdict=None):
        """The request of this very session; with evidence and verdict, what decided it."""
        if verdict is None:
            kind, record, argument, t_ms = "ProofRequested", session, {"pad_id": session.pad_id}, session.requested_ms
            writes = {keys.composite(keys.SESSION, session.session_id): session.encode()}
        else:
            kind, record, t_ms = "ProofDecided", verdict, verdict.decided_ms
            argument = {"session_id": session.session_id, "evidence": evidence.to_json()}
            ended = replace(session, state="decided", decided_ms=t_ms)
            writes = {
                keys.composite(keys.SESSION, session.session_id): ended.encode(),
                keys.composite(keys.VERDICT, session.session_id): verdict.encode(),
            }
        event = (kind, encoding.encode({"kind": kind, "record": record.to_json()}))
        function, tx_id = ("RequestProof", session.session_id) if verdict is None else ("SubmitProof", "")
        return Tx(function, argument, writes, event, t_ms=t_ms, tx_id=tx_id)

    def complete(self, name, pad_id="pad-1", uav_id="uav-1", t_ms=START_MS, state="completed"):
        session_id = number("session", name)
        times = {"decided_ms": t_ms + 2_000, "ended_ms": t_ms + 5_000}
        record = self.session(session_id, pad_id, uav_id, t_ms, state=state, end="done", ended_by="uav", **times)
        writes = {keys.composite(keys.SESSION, session_id): record.encode()}
        kind = "InteractionCompleted" if state == "completed" else "ProofCancelled"
        event = (kind, encoding.encode({"kind": kind, "record": record.to_json()}))
        return Tx("CompleteInteraction", {"session_id": session_id}, writes, event, t_ms=t_ms + 5_000)


@pytest.fixture(scope="session")
def authorities(tmp_path_factory):
    return Authorities(tmp_path_factory.mktemp("ca"))


@pytest.fixture
def chain(authorities):
    return ChainBuilder(authorities)


@pytest.fixture(name="new_chain")
def _new_chain(authorities):
    return lambda **options: ChainBuilder(authorities, **options)


@pytest.fixture
def facts():
    return Facts()


@pytest.fixture(name="tx")
def _tx():
    return Tx


@pytest.fixture(name="source_of")
def _source_of():
    return Source


@pytest.fixture(name="number")
def _number():
    return number


def make_tables(url):
    async def make():
        opened = Database(url)
        await migrate(opened)
        await opened.close()

    asyncio.run(make())


class Postgres:
    """A private PostgreSQL server, run as somebody other than root."""

    def __init__(self, programs, directory):
        self.programs = programs
        self.directory = directory
        self.user = "postgres" if os.geteuid() == 0 else None
        self.data = directory / "data"
        self.count = 0
        self.template = None

    def run(self, program, *arguments):
        command = [str(self.programs / program), *arguments]
        if self.user is not None:
            command = ["setpriv", f"--reuid={self.user}", f"--regid={self.user}", "--clear-groups", *command]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, cwd=self.directory)
        if done.returncode:
            raise RuntimeError(f"{program}: {done.stdout} {done.stderr}")

    def start(self):
        if self.user is not None:
            owner = pwd.getpwnam(self.user)
            os.chown(self.directory, owner.pw_uid, owner.pw_gid)
        self.run("initdb", "-D", str(self.data), "-U", "wonderland", "-A", "trust", "-E", "UTF8", "--no-sync")
        self.restart()

    def restart(self):
        options = f"-c listen_addresses='' -c unix_socket_directories={self.directory} -c fsync=on"
        self.run("pg_ctl", "-D", str(self.data), "-w", "-l", str(self.directory / "log"), "-o", options, "start")

    def stop(self):
        self.run("pg_ctl", "-D", str(self.data), "-m", "immediate", "-w", "stop")

    def new_database(self, *, migrated=False):
        """The URL of a new database; a migrated one is a copy: migrating takes longer than most tests."""
        self.count += 1
        name = f"test_{self.count}"
        copied = []
        if migrated:
            self.template = self.template or self.new_template()
            copied = ["--template", self.template]
        self.run("createdb", "-h", str(self.directory), "-U", "wonderland", *copied, name)
        return self.url(name)

    def new_template(self):
        self.run("createdb", "-h", str(self.directory), "-U", "wonderland", "template_migrated")
        make_tables(self.url("template_migrated"))
        return "template_migrated"

    def url(self, name):
        return f"postgresql://wonderland@/{name}?host={self.directory}"


@pytest.fixture(scope="session")
def postgres(request):
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    on_path = shutil.which("initdb")
    programs = found[-1].parent if found else Path(on_path).parent if on_path else None
    if programs is None:
        pytest.skip("PostgreSQL's server programs (initdb, pg_ctl) are not installed")
    if os.geteuid() == 0:
        try:
            pwd.getpwnam("postgres")
        except KeyError:
            pytest.skip("PostgreSQL refuses root, and there is no user postgres to run it as")
        if shutil.which("setpriv") is None:
            pytest.skip("PostgreSQL refuses root, and there is no setpriv to become another user")
    # Not below pytest's own directory, which only its owner may enter.
    import tempfile

    with tempfile.TemporaryDirectory(prefix="wl-pg-") as directory:
        server = Postgres(programs, Path(directory))
        server.start()
        try:
            yield server
        finally:
            server.stop()


@pytest.fixture
def database_url(request, tmp_path):
    """SQLite, unless a test asks for both kinds by ``parametrize(..., indirect=True)``."""
    if getattr(request, "param", "sqlite") == "sqlite":
        return f"sqlite:///{tmp_path / 'test.db'}"
    return request.getfixturevalue("postgres").new_database(migrated="database" in request.fixturenames)


@pytest.fixture(scope="session")
def migrated_file(tmp_path_factory):
    """A migrated SQLite database to copy: migrating takes longer than most tests."""
    path = tmp_path_factory.mktemp("template") / "template.db"
    make_tables(f"sqlite:///{path}")
    return path


@pytest.fixture
async def database(database_url, migrated_file):
    opened = Database(database_url)
    if opened.is_sqlite:
        shutil.copy(migrated_file, opened.url.database)
    yield opened
    await opened.close()


class Clock:
    """Milliseconds that a test sets."""

    def __init__(self, now_ms=START_MS):
        self.now_ms = now_ms

    def __call__(self):
        return self.now_ms


@pytest.fixture
def clock():
    return Clock()


class Running:
    """A backend that serves, and a client of it."""

    def __init__(self, backend, url, http):
        self.backend = backend
        self.url = url
        self.http = http

    @property
    def context(self):
        return self.backend.context

    @property
    def parts(self):
        return self.backend.parts

    async def sign_in(self):
        token = await self.parts.sign_ins.new_token("Inspector", ("inspector",))
        answer = await self.http.post("/api/v1/session", json={"token": token})
        assert answer.status_code == 200, answer.text

    async def get(self, path, **options):
        return await self.http.get(f"/api/v1{path}", **options)

    async def json(self, path, **parameters):
        answer = await self.get(path, params=parameters)
        assert answer.status_code == 200, answer.text
        return answer.json()

    async def mirrored(self, height):
        async with asyncio.timeout(10):
            while self.parts.mirror.mirrored < height:
                assert self.parts.mirror.halted is None
                await asyncio.sleep(0.005)

    def cookie(self):
        return "; ".join(f"{name}={value}" for name, value in self.http.cookies.items())

    def connect(self, path, **options):
        return websockets.connect(self.url.replace("http", "ws", 1) + path, proxy=None, compression=None, **options)

    def live(self, since=None, packed=False, **options):
        query = "?packed=zlib" if packed else "?"
        query += f"&since={since}" if since else ""
        headers = {"Cookie": self.cookie()}
        return self.connect(f"/api/v1/live{query}", additional_headers=headers, **options)


@contextlib.asynccontextmanager
async def serving(backend):
    """Serve a backend on a free port; yields a signed-in client."""
    server = new_server(backend.app, backend.settings)
    bound = Listen("127.0.0.1", 0).open()
    url = f"http://127.0.0.1:{bound.getsockname()[1]}"
    async with backend.running():
        task = asyncio.create_task(server.serve([bound]))
        while not server.started:
            await asyncio.sleep(0.005)
        try:
            async with httpx.AsyncClient(base_url=url, trust_env=False, timeout=30) as http:
                running = Running(backend, url, http)
                await running.sign_in()
                yield running
        finally:
            backend.end_streams()
            server.should_exit = True
            await task
            bound.close()


@pytest.fixture(name="serving")
def _serving():
    return serving


@pytest.fixture(name="new_backend")
def _new_backend(database, clock):
    def make(source=None, *, database=database, clock=clock, allowed_hosts=frozenset({"127.0.0.1"}), **options):
        settings = Settings(**{"tick_ms": 20, **options})
        return Backend(
            settings,
            database=database,
            source=source,
            channel="wonderland",
            chaincode="pol",
            ledger_kind="embedded",
            ledger_notice="no multi-party trust",
            allowed_hosts=allowed_hosts,
            clock=clock,
            console_directory=Path("/nowhere"),
        )

    return make


@pytest.fixture
async def running(new_backend, chain, source_of):
    """A backend on a chain with a pad, drones and three sessions."""
    facts = Facts()
    chain.add(facts.put_pad(), facts.put_pad("pad-2", commissioned=False), facts.put_uav(), facts.put_uav("uav-2"))
    chain.add(facts.grant(), facts.set_policy(), facts.request("one"))
    chain.add(facts.decide("one"), Tx(code=11))
    chain.add(facts.complete("one"), facts.request("two", uav_id="uav-2", t_ms=START_MS + 10_000))
    chain.add(facts.decide("two", uav_id="uav-2", t_ms=START_MS + 10_000, outcome="refuted"))
    chain.add(facts.request("three", pad_id="pad-2", t_ms=START_MS + 20_000))
    async with serving(new_backend(source_of(chain))) as client:
        await client.mirrored(chain.height)
        yield client


class AgentClient:
    """An agent's side of the ingest protocol, for tests to do right and wrong."""

    def __init__(self, socket, enrolment, *, agent="pad", agent_id="pad-1", spool="0" * 32, msp_id="PadMSP"):
        self.socket = socket
        self.enrolment = enrolment
        self.agent = agent
        self.agent_id = agent_id
        self.spool = spool
        self.msp_id = msp_id
        self.seq = 0

    async def receive(self):
        return json.loads(await asyncio.wait_for(self.socket.recv(), 5))

    async def send(self, message):
        await self.socket.send(message if isinstance(message, str | bytes) else json.dumps(message))

    async def hello(self, **change):
        challenge = await self.receive()
        assert challenge["type"] == "challenge"
        text = signed_text(
            nonce=challenge["nonce"],
            server=challenge["server"],
            agent=self.agent,
            agent_id=self.agent_id,
            spool=self.spool,
        )
        signature = key_signer(load_pem_private_key(self.enrolment.private_key_pem, None))(text)
        message = {
            "type": "hello",
            "protocol": "wonderland-ingest/1",
            "agent": self.agent,
            "id": self.agent_id,
            "spool": self.spool,
            "msp_id": self.msp_id,
            "certificate": self.enrolment.certificate_pem.decode(),
            "signature": base64.urlsafe_b64encode(signature).rstrip(b"=").decode(),
        }
        await self.send(message | change)
        return await self.receive()

    async def report(self, *records, t_ms=START_MS):
        entries = []
        for kind, body in records:
            self.seq += 1
            entries.append({"seq": self.seq, "kind": kind, "t_ms": t_ms, "body": body})
        await self.send({"type": "records", "records": entries})
        return await self.receive()


@pytest.fixture(name="agent_client")
def _agent_client(authorities):
    def make(socket, *, agent="pad", agent_id="pad-1", msp_id="PadMSP", **options):
        enrolment = options.pop("enrolment", None) or authorities.enrol(agent_id, msp_id, role=agent, id=agent_id)
        return AgentClient(socket, enrolment, agent=agent, agent_id=agent_id, msp_id=msp_id, **options)

    return make


@pytest.fixture(name="ledger_error")
def _ledger_error():
    return LedgerError
