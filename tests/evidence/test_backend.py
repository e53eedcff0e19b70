"""The console's button: the same file, by the backend from the ledger, for officers, and audited."""

import asyncio
import contextlib
from dataclasses import replace

import httpx
import pytest
from kit.openings import keep, opening
from kit.timestamping import OPENSSL, Service
from sqlalchemy import select

from wonderland_backend.db.tables.audit import AuditRow
from wonderland_backend.db.tables.ledger import SessionRow
from wonderland_backend.personal_data.store import erase
from wonderland_backend.personal_data.subjects import Erased, Subject
from wonderland_backend.serve import backend_of
from wonderland_backend.settings import Settings
from wonderland_evidence.verify import verify
from wonderland_fabric_gateway.certificates import certificate_of

pytestmark = pytest.mark.timeout(120)


@contextlib.asynccontextmanager
async def backend_on(shown, database, **more):
    """A backend that has mirrored the session, and ``ask(role, path)``."""
    settings = Settings(connection=shown.place.connection_file, database=f"sqlite:///{database}", **more)
    async with backend_of(settings, frozenset({"127.0.0.1"})) as backend:
        transport = httpx.ASGITransport(app=backend.app)

        async def ask(role, path):
            async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as http:
                token = await backend.parts.sign_ins.new_token("Someone", (role,))
                assert (await http.post("/api/v1/session", json={"token": token})).status_code == 200
                return await http.get(path)

        async with asyncio.timeout(20):
            while backend.parts.mirror.mirrored <= max(block.number for block in shown.bundle.blocks):
                await asyncio.sleep(0.02)
        yield backend, ask


def path_of(session_id):
    return f"/api/v1/sessions/{session_id}/evidence"


async def test_an_officer_gets_the_file_and_a_viewer_does_not(small, tmp_path):
    async with backend_on(small, tmp_path / "b.db") as (backend, ask):
        answer = await ask("inspector", path_of(small.session_id))
        assert answer.status_code == 200, answer.text
        assert answer.headers["content-disposition"] == f'attachment; filename="evidence-{small.session_id[:12]}.json"'
        report = small.report(answer.content)
        assert report.failed is None
        assert report.is_whole
        assert (await ask("viewer", path_of(small.session_id))).status_code == 403
        assert (await ask("inspector", path_of("0" * 64))).status_code == 404
        async with backend.context.database.read() as database:
            rows = (await database.scalars(select(AuditRow))).all()
        assert [row.subject for row in rows if row.act == "read_contents"] == [f"session/{small.session_id}"]


@pytest.mark.skipif(OPENSSL is None, reason="openssl is needed")
async def test_it_is_stamped_where_a_service_is_configured(small, tmp_path):
    service = Service(tmp_path)
    with service.served():
        async with backend_on(small, tmp_path / "b.db", timestamp_url=service.url) as (_, ask):
            answer = await ask("inspector", path_of(small.session_id))
    pins = replace(small.pins, timestamp_roots=(certificate_of(service.root.read_bytes()),))
    assert {each.status for each in verify(answer.content, pins).findings} == {"holds"}
    async with backend_on(small, tmp_path / "c.db", timestamp_url=service.url) as (_, ask):
        answer = await ask("inspector", path_of(small.session_id))
    assert answer.status_code == 503
    assert "does not answer" in answer.json()["detail"]


async def test_an_erasure_leaves_the_proof(small, tmp_path):
    """All that the command takes of the drone is gone, and its session's evidence holds step by step as before."""
    async with backend_on(small, tmp_path / "b.db") as (backend, ask):
        database = backend.context.database
        async with database.read() as session:
            uav_id = (await session.scalars(select(SessionRow.uav_id))).first()
        await keep(database, opening(uav_id))
        erased = Erased(Subject("drone", uav_id), 1, (opening(uav_id).commitment,))
        async with database.write() as connection:
            found = await erase(connection, erased, "article 17", 1, dry=False)
        assert found["registration_numbers"] == 1
        answer = await ask("inspector", path_of(small.session_id))
        report = small.report(answer.content)
        assert report.failed is None
        assert report.is_whole
        await backend.row_check.once()
        assert backend.parts.mirror.rows_differ == ()
