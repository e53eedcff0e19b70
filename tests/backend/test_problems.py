"""Problems in every language: each kind has its title, and no sentence of the catalogue is left over."""

from __future__ import annotations

import ast
import contextlib
import importlib
import pkgutil
from pathlib import Path

import pytest

import wonderland.registry
import wonderland_backend
from wonderland import messages, problems
from wonderland.problems import SaidError
from wonderland_backend.errors import Problem
from wonderland_backend.field_texts import KINDS, PREFIX

SOURCE = Path(wonderland_backend.__file__).parent
CORE = Path(wonderland.registry.__file__).parent


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


SAYING = {"said": "problems", "ArchiveError": "maps", "ReplacedError": "maps", "ImageryError": "maps"}
"""What is called with a key and facts, and of which catalogue they are."""


def sentences(domain):
    """Every sentence of a catalogue that the backend says: where, its key, the facts that it gives."""
    for path in [*SOURCE.rglob("*.py"), *CORE.rglob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and SAYING.get(getattr(node.func, "id", "")) == domain:
                key, facts = node.args[0], {each.arg for each in node.keywords}
                assert isinstance(key, ast.Constant), f"{path}:{node.lineno}: its key stands where it is said"
                yield f"{path}:{node.lineno}", key.value, facts


@pytest.mark.parametrize("language", messages.LANGUAGES)
@pytest.mark.parametrize("domain", sorted(set(SAYING.values())))
def test_every_sentence_is_in_every_language_with_the_facts_that_are_given(domain, language):
    # pydantic's codes choose among these; tests/messages/test_field_texts.py holds their facts.
    said = {PREFIX + each for each in KINDS.values()} if domain == "problems" else set()
    for where, key, facts in sentences(domain):
        said.add(key)
        assert messages.facts_of(domain, key, language) == facts, f"{where} {key}"
    assert said == messages.keys_of(domain, language)


def test_what_no_catalogue_has_cannot_be_said():
    with pytest.raises(KeyError):
        problems.said("nothing_of_the_kind")


def test_what_stands_in_a_sentence_is_in_its_language_too():
    refused = SaidError(problems.said("target_no_url"))
    text = problems.said("bad_url", why=refused)
    assert (str(text), text.text("fi")) == ("url: this is no URL.", "url: tämä ei ole URL.")
    assert str(problems.said("bad_url", why=ValueError("what it says"))) == "url: what it says."


async def test_the_request_chooses_the_language(running):
    for path, title in (("/verdicts?nonsense=1", "Pyyntöä ei voi käsitellä"), ("/nowhere", "Ei löytynyt")):
        told = {}
        for language in ("fi", "en", "sv"):
            answer = await running.get(path, headers={"Accept-Language": language})
            told[language] = answer.json()
        assert told["fi"]["title"] == title
        assert told["sv"] == told["en"] != told["fi"]
        assert told["fi"]["type"] == told["en"]["type"]
        key = {"/nowhere": "nothing_here"}.get(path, "request_fields")
        assert told["fi"]["detail"] == messages.text("problems", key, {}, "fi")
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
