"""What is to go says so: in the description, on the reference page, and in every answer, refusals included."""

from __future__ import annotations

import json
from datetime import date

import httpx
import pytest
from fastapi import Request

from wonderland_backend.deprecation import deprecated
from wonderland_backend.description import openapi
from wonderland_backend.errors import NotFound, documented
from wonderland_backend.reference.page import rendered
from wonderland_backend.responses import resource
from wonderland_backend.routes import new_app
from wonderland_backend.settings import Settings

MARK = {"since": date(2027, 1, 1), "until": date(2027, 7, 10), "instead": "https://example.com/api/changes#old"}


@pytest.fixture
def app():
    found = new_app(Settings(), frozenset(), None)

    @found.get(
        "/old/{name}",
        tags=["server"],
        responses=documented(NotFound, etag=True),
        response_model=None,
        **deprecated(**MARK),
    )
    async def read_old(request: Request, name: str):
        """What there was before."""
        if name != "thing":
            raise NotFound("There is no such thing.")
        return resource(request, {"name": name}, headers={"Link": '</old/next>; rel="next"'})

    found.router.routes.insert(0, found.router.routes.pop())  # before the console, which takes every address
    return found


@pytest.mark.parametrize(("name", "status"), [("thing", 200), ("nothing", 404)])
async def test_every_answer_says_since_when_and_until_when(app, name, status):
    async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as http:
        answer = await http.get(f"/old/{name}")
    assert answer.status_code == status
    assert answer.headers["deprecation"] == "@1798761600"
    assert answer.headers["sunset"] == "Sat, 10 Jul 2027 00:00:00 GMT"
    links = [value for key, value in answer.headers.multi_items() if key == "link"]
    assert '<https://example.com/api/changes#old>; rel="deprecation"; type="text/html"' in links
    assert ('</old/next>; rel="next"' in links) == (status == 200)


async def test_what_stays_says_nothing_of_it(app):
    async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as http:
        answer = await http.get("/api/v1/health")
    assert answer.status_code == 200
    assert not {"deprecation", "sunset", "link"} & set(answer.headers)


def test_the_description_and_the_page_say_so(app):
    document = openapi(app)
    operation = document["paths"]["/old/{name}"]["get"]
    assert (operation["deprecated"], operation["x-sunset"]) == (True, "2027-07-10")
    for status in ("200", "404"):
        assert {"Deprecation", "Sunset", "Link"} <= set(operation["responses"][status]["headers"])
    marked = [
        path for path, methods in document["paths"].items() for each in methods.values() if each.get("deprecated")
    ]
    assert marked == ["/old/{name}"]
    page = rendered(json.dumps(document), "http://localhost")
    assert 'works until 2027-07-10. <a href="https://example.com/api/changes#old">' in page


def test_half_a_year_is_the_least_notice():
    with pytest.raises(ValueError, match="182 days"):
        deprecated(**MARK | {"until": date(2027, 6, 1)})
