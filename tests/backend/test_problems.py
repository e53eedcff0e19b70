"""Problems in Finnish: every kind has its title, and no translation outlives the English text that it is of."""

from __future__ import annotations

import contextlib
import importlib
import pkgutil
import re
from pathlib import Path

import backend
from backend import problems_fi
from backend.errors import Problem

SOURCE = Path(backend.__file__).parent


def kinds():
    for module in pkgutil.walk_packages(backend.__path__, "backend."):
        importlib.import_module(module.name)
    found, waiting = set(), [Problem]
    while waiting:
        each = waiting.pop()
        found.add(each.code)
        waiting += each.__subclasses__()
    return found


def test_every_kind_of_problem_has_a_finnish_title():
    assert kinds() <= set(problems_fi.TITLES)


def test_every_finnish_detail_is_of_a_text_that_the_backend_says():
    said = "".join(path.read_text() for path in SOURCE.rglob("*.py") if path.name != "problems_fi.py")
    # A text may go on in the next line of the source.
    said = re.sub(r'"\s*\n\s*f?"', "", said)
    missing = [english for english in problems_fi.DETAILS if f'"{english}"' not in said]
    assert missing == []


async def test_the_request_chooses_the_language(running):
    for path, title in (("/verdicts?nonsense=1", "Pyyntöä ei voi käsitellä"), ("/nowhere", "Ei löytynyt")):
        told = {}
        for language in ("fi", "en", "sv"):
            answer = await running.get(path, headers={"Accept-Language": language})
            told[language] = answer.json()
        assert told["fi"]["title"] == title
        assert told["sv"] == told["en"] != told["fi"]
        assert told["fi"]["type"] == told["en"]["type"]
        assert told["fi"]["detail"] == problems_fi.DETAILS[told["en"]["detail"]]
    running.http.cookies.clear()
    answer = await running.get("/pads", headers={"Accept-Language": "fi"})
    assert (answer.status_code, answer.json()["detail"]) == (401, "Kirjaudu ensin.")


async def test_no_connection_to_the_database_is_free(running, monkeypatch):
    engine = running.context.database.engine
    monkeypatch.setattr(engine.pool, "_timeout", 0.05)
    async with contextlib.AsyncExitStack() as stack:
        for _ in range(20):
            await stack.enter_async_context(engine.connect())
        answer = await running.get("/verdicts")
        assert (answer.status_code, answer.headers["Retry-After"]) == (503, "5")
        assert answer.json()["type"] == "urn:wonderland:problem:database-busy"
    assert (await running.get("/verdicts")).status_code == 200
