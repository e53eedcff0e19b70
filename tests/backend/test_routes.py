"""The application as an object."""

import gc
import weakref
from pathlib import Path

import httpx
import pytest

from wonderland_backend.routes import new_app
from wonderland_backend.settings import Settings


def test_nothing_holds_an_application_that_is_no_longer_used():
    app = new_app(Settings(), allowed_hosts=frozenset({"127.0.0.1"}), console_directory=Path("/nowhere"))
    left = weakref.ref(app)
    del app
    gc.collect()
    assert left() is None


@pytest.fixture
async def asked(tmp_path):
    """An application with a console's page; no server, no database."""
    (tmp_path / "index.html").write_text("the page")
    app = new_app(Settings(), frozenset(), tmp_path)
    async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as http:
        yield http


@pytest.mark.parametrize("start", ["/api", "/oauth", "/.well-known", "/uss", "/metrics", "/health", "/ingest"])
async def test_no_page_of_the_console_is_where_machines_ask(asked, start):
    assert (await asked.get("/map")).text == "the page"
    for path in (start, f"{start}/", f"{start}/nothing", f"{start}/nothing/here"):
        for method in ("GET", "POST", "OPTIONS", "HEAD"):
            answer = await asked.request(method, path)
            told = (answer.status_code, answer.headers["content-type"], "allow" in answer.headers)
            assert told == (404, "application/problem+json", False), (method, path)


@pytest.mark.parametrize(
    ("path", "methods"),
    [
        ("/api/v1/people/someone", "DELETE, GET, HEAD, PATCH"),
        ("/oauth/token", "POST"),
        ("/api/v1/openapi.json", "GET, HEAD"),
        ("/api/v1/reference", "GET, HEAD"),
        ("/api/v1/pads", "GET, HEAD"),
        ("/api/v1/session", "DELETE, GET, HEAD, POST"),
    ],
)
async def test_what_may_be_done_with_a_path_is_told_whole(asked, path, methods):
    for method in {"PUT", "OPTIONS", "GET", "TRACE"} - set(methods.split(", ")):
        answer = await asked.request(method, path)
        assert (answer.status_code, answer.headers["allow"]) == (405, methods), method


async def test_a_head_is_what_a_get_would_begin_with(running):
    for path in ("/api/v1/pads", "/api/v1/health", "/api/v1/nothing"):
        got, head = await running.http.get(path), await running.http.head(path)
        assert (head.status_code, head.content) == (got.status_code, b"")
        assert head.headers["content-type"] == got.headers["content-type"]
        assert head.headers["content-length"] == got.headers["content-length"]


async def test_long_answers_are_compressed_for_who_takes_them(running):
    plain = await running.http.get("/api/v1/openapi.json", headers={"Accept-Encoding": "identity"})
    small = await running.http.get("/api/v1/openapi.json", headers={"Accept-Encoding": "gzip"})
    assert "content-encoding" not in plain.headers
    assert (small.headers["content-encoding"], small.headers["vary"]) == ("gzip", "Accept-Encoding")
    assert small.content == plain.content
    assert int(small.headers["content-length"]) * 8 < len(plain.content)
    short = await running.http.get("/api/v1/health", headers={"Accept-Encoding": "gzip"})
    assert "content-encoding" not in short.headers
