"""Serving the built console."""

from __future__ import annotations

import httpx
import pytest

from wonderland_backend.console import find_console
from wonderland_backend.routes import new_app
from wonderland_backend.settings import Settings


@pytest.fixture
def built(tmp_path):
    (tmp_path / "assets").mkdir()
    (tmp_path / "index.html").write_text("<!doctype html><title>Wonderland</title>")
    (tmp_path / "assets" / "app-1a2b.js").write_text("export const answer = 42;\n" * 100)
    return tmp_path


async def get(app, path, **headers):
    async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as http:
        return await http.get(path, headers=headers)


@pytest.mark.parametrize("path", ["/", "/sessions", "/pads/pad-1", "/assets/", "/assets"])
async def test_the_page_stands_at_every_address_of_its_own(built, path):
    app = new_app(Settings(), frozenset(), built)
    answer = await get(app, path)
    assert answer.status_code == 200
    assert "Wonderland" in answer.text
    assert answer.headers["cache-control"] == "no-cache"


async def test_assets_are_kept_and_compressed(built):
    app = new_app(Settings(), frozenset(), built)
    answer = await get(app, "/assets/app-1a2b.js")
    assert "immutable" in answer.headers["cache-control"]
    assert answer.headers["content-encoding"] == "gzip"
    assert answer.headers["content-type"].startswith("text/javascript")


@pytest.mark.parametrize(
    ("accepted", "encoding", "body"),
    [
        ("gzip, deflate, br, zstd", "br", b"smallest"),
        ("gzip;q=1, br;q=0", "gzip", b"small"),
        ("identity", None, b"whole"),
        ("", None, b"whole"),
    ],
)
async def test_what_the_build_has_compressed_is_sent_as_it_is(built, accepted, encoding, body):
    for name, content in (("a-1.js", b"whole"), ("a-1.js.br", b"smallest"), ("a-1.js.gz", b"small")):
        (built / "assets" / name).write_bytes(content)
    app = new_app(Settings(), frozenset(), built)
    transport = httpx.ASGITransport(app)
    async with (
        httpx.AsyncClient(transport=transport, base_url="http://localhost") as http,
        http.stream("GET", "/assets/a-1.js", headers={"Accept-Encoding": accepted}) as answer,
    ):
        assert answer.headers.get("content-encoding") == encoding
        assert b"".join([piece async for piece in answer.aiter_raw()]) == body
        assert answer.headers["content-type"].startswith("text/javascript")
        assert "immutable" in answer.headers["cache-control"]
        assert encoding is None or answer.headers["vary"] == "Accept-Encoding"


@pytest.mark.parametrize(
    "path", ["/assets/gone.js", "/../../etc/passwd.txt", "/%2e%2e/%2e%2e/etc/passwd.txt", "/api/v2/x"]
)
async def test_what_is_not_there_is_a_problem(built, path):
    answer = await get(new_app(Settings(), frozenset(), built), path)
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/problem+json"


async def test_other_methods_are_told_what_is_allowed(built):
    app = new_app(Settings(), frozenset(), built)
    async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as http:
        assert (await http.put("/api/v1/pads")).headers["allow"] == "GET, HEAD"
        answer = await http.put("/sessions")
        assert (answer.status_code, set(answer.headers["allow"].split(", "))) == (405, {"GET", "HEAD"})
        for path in ("/", "/api/v1/health", "/oauth/token"):
            traced = await http.request("TRACE", path, headers={"Cookie": "secret"})
            assert (traced.status_code, "secret" in traced.text) == (405, False)


async def test_without_a_console_it_says_so(tmp_path):
    app = new_app(Settings(), frozenset(), tmp_path)
    answer = await get(app, "/")
    assert "not built" in answer.text
    assert find_console(tmp_path) is None
