"""Problems in every language: each kind has its title, and no sentence of the catalogue is left over."""

from __future__ import annotations

import contextlib
import importlib
import pkgutil
from pathlib import Path

import pytest

import wonderland_backend
from wonderland import messages
from wonderland_backend import problem_texts
from wonderland_backend.errors import Problem

SOURCE = Path(wonderland_backend.__file__).parent


def finnish_of(english):
    """What stands for an English sentence in the Finnish catalogue."""
    (key,) = [key for key in messages.keys_of("problems") if messages.text("problems", key, {}) == english]
    return messages.text("problems", key, {}, "fi")


def kinds():
    for module in pkgutil.walk_packages(wonderland_backend.__path__, "wonderland_backend."):
        importlib.import_module(module.name)
    found, waiting = set(), [Problem]
    while waiting:
        each = waiting.pop()
        found.add(each.code)
        waiting += each.__subclasses__()
    return found


def test_every_kind_of_problem_has_its_title():
    assert kinds() <= messages.keys_of("problem-titles")
    assert messages.keys_of("problem-titles") == messages.keys_of("problem-titles", "fi")


def test_every_sentence_is_one_that_the_backend_says_and_in_every_language():
    said = "".join(path.read_text() for path in SOURCE.rglob("*.py"))
    unused = [key for key in messages.keys_of("problems") if f'said("{key}"' not in said]
    assert unused == []
    assert messages.keys_of("problems") == messages.keys_of("problems", "fi")
    with pytest.raises(KeyError):
        problem_texts.said("nothing_of_the_kind")


async def test_the_request_chooses_the_language(running):
    for path, title in (("/verdicts?nonsense=1", "Pyyntöä ei voi käsitellä"), ("/nowhere", "Ei löytynyt")):
        told = {}
        for language in ("fi", "en", "sv"):
            answer = await running.get(path, headers={"Accept-Language": language})
            told[language] = answer.json()
        assert told["fi"]["title"] == title
        assert told["sv"] == told["en"] != told["fi"]
        assert told["fi"]["type"] == told["en"]["type"]
        assert told["fi"]["detail"] == finnish_of(told["en"]["detail"])
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
