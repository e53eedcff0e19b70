"""The uplink against the project's own backend: what the pad's parts write is what the ingest reads."""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from sqlalchemy import func, select

from wonderland import telemetry
from wonderland.telemetry import Credentials
from wonderland_backend.app import Backend
from wonderland_backend.db.engine import Database
from wonderland_backend.db.migrate import migrate
from wonderland_backend.db.tables.reported import HealthRow, IrregularRow, SessionEndRow, SpoolRow, StepRow, TrackRow
from wonderland_backend.listening import Listen
from wonderland_backend.serve import new_server
from wonderland_backend.settings import Settings
from wonderland_edge_agent.receiver import Assembler
from wonderland_edge_agent.spool import Spool
from wonderland_edge_agent.uplink import Uplink, UplinkTimings, WebSocketTransport
from wonderland_fabric_gateway.ca.local import LocalCa
from wonderland_fabric_gateway.signing import key_signer
from wonderland_remote_id import BasicId, HorizontalAccuracy, Location, OperatorId, Pack, encode

NOW = 1_800_000_000_000
SERIAL = "1581F5FKD229400A1234"
SESSION = "ab" * 32
FAST = UplinkTimings(backoff_s=0.01, backoff_max_s=0.05)


@pytest.fixture(scope="module")
def organisation(tmp_path_factory: pytest.TempPathFactory) -> LocalCa:
    return LocalCa.create(tmp_path_factory.mktemp("ca") / "PadMSP", "PadMSP")


@pytest.fixture(scope="module")
def credentials(organisation: LocalCa) -> Credentials:
    return enrolled(organisation, "pad-1")


def enrolled(organisation: LocalCa, pad_id: str) -> Credentials:
    enrolment = organisation.enrol(pad_id, attributes={"pol.role": "pad", "pol.id": pad_id})
    assert enrolment.private_key_pem is not None
    key: Any = load_pem_private_key(enrolment.private_key_pem, None)
    return Credentials(
        agent="pad",
        id=pad_id,
        msp_id="PadMSP",
        certificate_pem=enrolment.certificate_pem.decode(),
        sign=key_signer(key),
    )


@dataclass
class Served:
    url: str
    database: Database

    async def count(self, model: Any) -> int:
        async with self.database.read() as session:
            return (await session.scalar(select(func.count()).select_from(model))) or 0


@pytest.fixture
async def database(tmp_path: Path) -> AsyncIterator[Database]:
    opened = Database(f"sqlite:///{tmp_path / 'backend.db'}")
    await migrate(opened)
    yield opened
    await opened.close()


@contextlib.asynccontextmanager
async def serving(database: Database, organisation: LocalCa, port: int = 0) -> AsyncIterator[Served]:
    backend = Backend(
        Settings(tick_ms=20), database=database, allowed_hosts=frozenset({"127.0.0.1"}), clock=lambda: NOW
    )
    server = new_server(backend.app, backend.settings)
    bound = Listen("127.0.0.1", port).open()
    async with backend.running():
        await backend.parts.sign_ins.new_token("Inspector", ("inspector",))  # set up: agents are taken in from now on
        # What the mirror learns from the channel's configuration block.
        definition = {
            "root_certs": [organisation.root_pem().decode()],
            "intermediate_certs": [],
            "revocation_lists": [],
            "sections": ["Application"],
        }
        backend.parts.members.configure([("PadMSP", json.dumps(definition))])
        task = asyncio.create_task(server.serve([bound]))
        while not server.started:
            await asyncio.sleep(0.005)
        try:
            yield Served(f"ws://127.0.0.1:{bound.getsockname()[1]}/ingest", database)
        finally:
            server.should_exit = True
            await task
            bound.close()


@pytest.fixture
async def spool(tmp_path: Path) -> AsyncIterator[Spool]:
    async with await Spool.open(tmp_path / "spool", owner="pad-1", reserve_bytes=0, linger_s=0.002) as opened:
        yield opened


async def until(condition: Callable[[], object], timeout_s: float = 15.0) -> None:
    async with asyncio.timeout(timeout_s):
        while not condition():
            await asyncio.sleep(0.005)


def heard_track() -> dict[str, Any]:
    frame = encode(
        Pack(
            messages=(
                BasicId(uas_id=SERIAL),
                Location(
                    lat_e7=604_518_000,
                    lon_e7=222_666_000,
                    track_cdeg=35_900,
                    speed_mm_s=254_250,
                    vertical_mm_s=-62_000,
                    altitude_mm=31_767_500,
                    horizontal_accuracy=HorizontalAccuracy.M_3,
                    after_hour_ms=1_000,
                ),
                OperatorId(operator_id="FIN87astrdge12k8-xyz"),
            )
        )
    )
    heard = Assembler(NOW).feed(frame, source="test", transport="serial", now_ms=NOW, rssi_dbm=-60)
    assert heard is not None
    return telemetry.plain(heard.track)


async def test_everything_a_pad_reports_is_taken(
    database: Database, organisation: LocalCa, spool: Spool, credentials: Credentials
) -> None:
    for _ in range(600):
        spool.offer("track", NOW, heard_track())
    step = {"session_id": SESSION, "uav_id": SERIAL, "step": "poll", "t_ms": NOW, "ok": True, "detail": "códe matched"}
    await spool.append("step", NOW, step, evidence=True)
    end = {"session_id": SESSION, "state": "completed", "steps": [{"step": "poll", "t_ms": NOW}]}
    await spool.append("session_end", NOW, end, evidence=True)
    spool.offer(
        "health",
        NOW,
        {
            "anchors": [],
            "spool": telemetry.plain(spool.status.health()),
            "receiver": telemetry.plain(Assembler(NOW).counts.health()),
            "prekeys": 3,
            "version": "0.1.0",
        },
    )
    async with serving(database, organisation) as served:
        uplink = Uplink(WebSocketTransport(served.url), credentials, spool, timings=FAST)
        await uplink.start()
        await until(lambda: spool.status.last_seq == 603 and spool.status.records == 0)
        assert uplink.status.rejected_records == 0
        assert await served.count(TrackRow) == 600
        assert await served.count(StepRow) == 1
        assert await served.count(SessionEndRow) == 1
        assert await served.count(HealthRow) == 1
        assert await served.count(IrregularRow) == 0
        await uplink.close()


async def test_backends_come_and_go_and_each_record_arrives_once(
    database: Database, organisation: LocalCa, spool: Spool, credentials: Credentials
) -> None:
    async with serving(database, organisation) as served:
        port = int(served.url.split(":")[2].split("/")[0])
        uplink = Uplink(WebSocketTransport(served.url), credentials, spool, timings=FAST, randomness=random.Random(1))
        await uplink.start()
        for _ in range(300):
            spool.offer("track", NOW, heard_track())
        await until(lambda: uplink.status.sent_records > 0)
    for _ in range(300):
        spool.offer("track", NOW, heard_track())
    await until(lambda: not uplink.status.connected)
    async with serving(database, organisation, port) as served:
        await until(lambda: spool.status.last_seq == 600 and spool.status.records == 0)
        assert await served.count(TrackRow) == 600
        async with database.read() as session:
            (row,) = (await session.scalars(select(SpoolRow))).all()
        assert (row.agent_id, row.spool, row.acknowledged) == ("pad-1", spool.id, 600)
        await uplink.close()


async def test_what_the_quota_dropped_is_on_the_backends_record(
    database: Database, organisation: LocalCa, tmp_path: Path, credentials: Credentials
) -> None:
    async with await Spool.open(tmp_path / "small", owner="pad-1", quota_bytes=256 * 1024, reserve_bytes=0) as spool:
        for _ in range(2_000):
            spool.offer("track", NOW, heard_track())
        await until(lambda: spool.status.last_seq == 2_000)
        dropped = spool.status.dropped
        assert dropped > 0
        async with serving(database, organisation) as served:
            uplink = Uplink(WebSocketTransport(served.url), credentials, spool, timings=FAST)
            await uplink.start()
            await until(lambda: spool.status.records == 0)
            assert await served.count(TrackRow) == 2_000 - dropped
            assert await served.count(IrregularRow) == 1
            await uplink.close()


async def test_a_second_agent_of_the_pad_is_refused_while_the_first_lives(
    database: Database, organisation: LocalCa, spool: Spool, tmp_path: Path, credentials: Credentials
) -> None:
    async with (
        serving(database, organisation) as served,
        await Spool.open(tmp_path / "other", owner="pad-1", reserve_bytes=0) as other,
    ):
        first = Uplink(WebSocketTransport(served.url), credentials, spool, timings=FAST)
        second = Uplink(WebSocketTransport(served.url), credentials, other, timings=FAST)
        await first.start()
        await until(lambda: first.status.connected)
        await second.start()
        await until(lambda: second.status.refusal == "duplicate_agent")
        assert first.status.connected
        await first.close()
        await until(lambda: second.status.connected)
        await second.close()


async def test_an_agent_the_ledger_does_not_know_stays_out(
    database: Database, organisation: LocalCa, spool: Spool, tmp_path: Path, credentials: Credentials
) -> None:
    stranger = enrolled(LocalCa.create(tmp_path / "strangers", "PadMSP"), "pad-1")
    wrong_pad = enrolled(organisation, "pad-2")
    async with serving(database, organisation) as served:
        await spool.append("step", NOW, {"x": 1}, evidence=True)
        for bad in (stranger, Credentials(**{**_fields(wrong_pad), "id": "pad-1"})):
            uplink = Uplink(WebSocketTransport(served.url), bad, spool, timings=FAST)
            await uplink.start()
            await until(lambda uplink=uplink: uplink.status.refusal)  # type: ignore[misc]
            await uplink.close()
        assert spool.status.records == 1


def _fields(credentials: Credentials) -> dict[str, Any]:
    return {name: getattr(credentials, name) for name in ("agent", "id", "msp_id", "certificate_pem", "sign")}
