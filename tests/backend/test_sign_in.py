"""Signing in: one token, one browser, one time; and what stands before every request."""

from __future__ import annotations

import asyncio

import httpx
import pytest
import websockets
from sqlalchemy import select, update

from wonderland_backend import app
from wonderland_backend.db.tables.people import LinkRow, PersonRow, SignInRow
from wonderland_backend.errors import SignInRequired
from wonderland_backend.people import links


def stranger(running, **options):
    return httpx.AsyncClient(base_url=running.url, trust_env=False, **options)


@pytest.mark.parametrize(
    "path", ["/session", "/status", "/pads", "/drones", "/sessions", "/verdicts", "/tracks", "/blocks", "/metrics"]
)
async def test_nothing_is_shown_to_strangers(running, path):
    async with stranger(running) as http:
        answer = await http.get(f"/api/v1{path}")
        assert answer.status_code == 401
        assert answer.json()["type"] == "urn:wonderland:problem:sign-in-required"
        http.cookies.set(running.context.cookie_name, "x" * 43)
        assert (await http.get(f"/api/v1{path}")).status_code == 401


async def test_a_token_serves_once(running):
    token = await running.parts.sign_ins.new_token("Inspector", ("inspector",))
    async with stranger(running) as first, stranger(running) as second:
        answer = await first.post("/api/v1/session", json={"token": token})
        assert answer.status_code == 200
        assert answer.json()["name"] == "Inspector"
        cookie = answer.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=strict" in cookie
        assert "secure" not in cookie
        assert token not in cookie
        again = await second.post("/api/v1/session", json={"token": token})
        assert again.status_code == 401
        assert "wonderland backend link" in again.json()["detail"]
        assert (await first.get("/api/v1/pads")).status_code == 200


async def test_tokens_expire(running, clock):
    token = await running.parts.sign_ins.new_token("Inspector", (), ttl_s=60)
    clock.now_ms += 60_000
    with pytest.raises(SignInRequired):
        await running.parts.sign_ins.redeem(token)


HOUR_MS = 3_600_000


async def use(running):
    answer = await running.http.post("/api/v1/session/use")
    assert answer.status_code == 204, answer.text


async def test_sign_ins_end(running, clock):
    for _ in range(3):
        clock.now_ms += 3 * HOUR_MS
        await use(running)
    clock.now_ms += 2 * HOUR_MS
    assert (await running.get("/session")).status_code == 200
    clock.now_ms += HOUR_MS
    assert (await running.get("/session")).status_code == 401, "however much it is used"
    await running.sign_in()
    clock.now_ms += 4 * HOUR_MS
    assert (await running.get("/session")).status_code == 401, "nobody used it"
    assert (await running.http.post("/api/v1/session/use")).status_code == 401


@pytest.fixture
async def checking(monkeypatch, new_backend, serving):
    """A server that looks often whether those with live connections are still signed in."""
    monkeypatch.setattr(app, "CHECK_EVERY_S", 0.01)
    async with serving(new_backend()) as running:
        yield running


async def test_a_page_that_stands_open_is_no_use(checking, clock):
    async with checking.live() as socket:
        for _ in range(8):
            clock.now_ms += HOUR_MS // 2 - 1
            assert (await checking.get("/status")).status_code == 200
            await asyncio.sleep(0.05)  # some checks of the live connection
        clock.now_ms += HOUR_MS // 2
        async with asyncio.timeout(5):
            with pytest.raises(websockets.ConnectionClosed) as closed:
                while True:
                    await socket.recv()
        assert closed.value.rcvd.code == 4401
    assert (await checking.get("/status")).status_code == 401


async def test_a_display_stays_signed_in_through_the_night(checking, clock):
    sign_ins = checking.parts.sign_ins
    token = await links.for_display(checking.context.database, sign_ins, "Control room", clock())
    assert (await checking.http.post("/api/v1/session", json={"token": token})).json()["roles"] == ["viewer"]
    async with checking.live() as socket:
        clock.now_ms += 29 * 24 * HOUR_MS
        await asyncio.sleep(0.05)  # some checks of the live connection
        assert (await checking.get("/session")).json()["method"] == "display"
        assert (await checking.get("/people")).status_code == 403
        await socket.ping()
        clock.now_ms += 24 * HOUR_MS
        async with asyncio.timeout(5):
            await socket.wait_closed()
    assert (await checking.get("/session")).status_code == 401


async def test_a_display_that_was_given_rights_is_a_person(running, clock):
    sign_ins = running.parts.sign_ins
    token = await links.for_display(running.context.database, sign_ins, "Control room", clock())
    await running.http.post("/api/v1/session", json={"token": token})
    async with running.context.database.write() as connection:
        await connection.execute(update(PersonRow).values(roles="admin viewer"))
    clock.now_ms += 4 * HOUR_MS
    assert (await running.get("/session")).status_code == 401


async def test_signing_out(running):
    assert (await running.http.delete("/api/v1/session")).status_code == 204
    assert (await running.get("/pads")).status_code == 401


async def test_only_hashes_are_kept(running):
    token = await running.parts.sign_ins.new_token("Inspector", ())
    cookie, _ = await running.parts.sign_ins.redeem(token)
    async with running.context.database.read() as session:
        kept = [str(vars(row)) for model in (LinkRow, SignInRow) for row in await session.scalars(select(model))]
    assert kept
    assert not any(token in each or cookie in each for each in kept)


@pytest.mark.parametrize(
    "body", [{}, {"token": ""}, {"token": 5}, {"token": "x", "name": "y"}, {"token": "x" * 200}, []]
)
async def test_malformed_sign_ins(running, body):
    answer = await running.http.post("/api/v1/session", json=body)
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"


async def test_two_backends_on_one_host_do_not_share_a_cookie(running, new_backend, tmp_path):
    from wonderland_backend.db.engine import Database
    from wonderland_backend.db.migrate import migrate

    other = Database(f"sqlite:///{tmp_path / 'second.db'}")
    await migrate(other)
    backend = new_backend(database=other)
    async with backend.running():
        assert backend.context.cookie_name != running.context.cookie_name
    again = new_backend()
    async with again.running():
        assert again.context.cookie_name == running.context.cookie_name


async def test_foreign_hosts_and_origins_are_refused(running):
    answer = await running.get("/health", headers={"Host": "evil.example"})
    assert (answer.status_code, answer.json()["type"]) == (421, "urn:wonderland:problem:unknown-host")
    host, _, port = running.url.partition("//")[2].partition(":")
    reader, writer = await asyncio.open_connection(host, int(port))
    writer.write(f"GET /api/v1/health HTTP/1.1\r\nHost: {host}\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode())
    assert (await asyncio.wait_for(reader.read(), 5)).split()[1] in {b"400", b"421"}
    writer.close()
    foreign = {"Origin": "http://evil.example"}
    answer = await running.http.post("/api/v1/session", json={"token": "x"}, headers=foreign)
    assert (answer.status_code, answer.json()["type"]) == (403, "urn:wonderland:problem:foreign-origin")
    answer = await running.http.post("/api/v1/session", json={"token": "x"}, headers={"Origin": running.url})
    assert answer.status_code == 401
    assert (await running.http.delete("/api/v1/session", headers=foreign)).status_code == 403


async def test_an_unencrypted_page_of_the_same_name_is_foreign_to_an_https_server(new_backend):
    backend = new_backend(public_url="https://wonderland.example", allowed_hosts=frozenset({"127.0.0.1"}))
    async with backend.running():
        transport = httpx.ASGITransport(backend.app)
        async with httpx.AsyncClient(transport=transport, base_url="https://127.0.0.1") as http:
            for scheme, is_foreign in (("http", True), ("https", False)):
                origin = {"Origin": f"{scheme}://127.0.0.1"}
                answer = await http.post("/api/v1/session", json={"token": "x"}, headers=origin)
                assert answer.json()["type"].endswith(":foreign-origin") == is_foreign, answer.text


async def test_large_bodies_are_refused(running):
    answer = await running.http.post("/api/v1/session", content=b"x" * 70_000)
    assert (answer.status_code, answer.json()["type"]) == (413, "urn:wonderland:problem:too-large")

    async def chunks():
        for _ in range(80):
            yield b"x" * 1_000

    answer = await running.http.post("/api/v1/session", content=chunks())
    assert answer.status_code == 413


async def test_every_answer_has_the_security_headers(running):
    for path in ("/api/v1/health", "/api/v1/nothing", "/", "/api/v1/pads"):
        headers = (await running.http.get(path)).headers
        assert "default-src 'none'" in headers["content-security-policy"]
        for directive in ("object-src 'none'", "base-uri 'none'", "frame-ancestors 'none'", "script-src 'self';"):
            assert directive in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert "server" not in headers
        assert "strict-transport-security" not in headers


async def test_behind_https_cookies_are_secure(new_backend, serving, database):
    backend = new_backend(public_url="https://wonderland.example", allowed_hosts=frozenset({"127.0.0.1"}))
    async with backend.running():
        transport = httpx.ASGITransport(backend.app)
        async with httpx.AsyncClient(transport=transport, base_url="https://127.0.0.1") as http:
            token = await backend.parts.sign_ins.new_token("Inspector", ())
            answer = await http.post("/api/v1/session", json={"token": token})
            assert answer.headers["set-cookie"].startswith("__Host-")
            assert "secure" in answer.headers["set-cookie"].lower()
            assert answer.headers["strict-transport-security"] == "max-age=31536000; includeSubDomains"
            assert (await http.get("/api/v1/session")).status_code == 200
