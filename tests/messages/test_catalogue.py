"""Every code has its words in every language, and every fact that they name exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from icu4py.messageformat import MessageFormat

from wonderland.messages import LANGUAGES, facts_of, keys_of, message_of, text
from wonderland.proofs.reasons import REASONS, reason
from wonderland_backend.alerts.kinds import SEVERITIES
from wonderland_backend.conformance.rules import Limit, Status

FOLDER = Path(__file__).resolve().parents[2] / "libraries" / "core" / "wonderland" / "messages"
DOMAINS = sorted(path.relative_to(FOLDER / "en").with_suffix("").as_posix() for path in FOLDER.glob("en/**/*.json"))
CONSOLE = Path(__file__).resolve().parents[2] / "frontend" / "src"
NAMES = {
    "reasons": set(REASONS),
    "alerts": set(SEVERITIES),
    "alert-titles": set(SEVERITIES),
    "emails": {"alert_subject"},
    "conformance": {f"status.{each}" for each in Status.__args__} | {f"limit.{each}" for each in Limit.__args__},
}


WORDS = ("_id", "_ids", "action", "failure", "stamps_of", "lacking", "geometry", "measured_by")
"""Facts that are texts."""


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("domain", DOMAINS)
def test_every_language_has_the_same_messages_and_all_are_icu(domain, language):
    assert keys_of(domain, language) == keys_of(domain, "en")
    for key in keys_of(domain, language):
        message = message_of(domain, key, language)
        assert message
        MessageFormat(message, language)
        assert "'" not in message, f"{key}: to ICU an apostrophe quotes; write ’"
        assert facts_of(domain, key, language) == facts_of(domain, key), f"{key} names other facts than in English"


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_console_shows_every_file_of_its_own_in_every_language(language):
    code = "".join(path.read_text() for path in CONSOLE.rglob("*.ts*"))
    shown = set(re.findall(rf'"@messages/{language}/([\w/-]+)\.json"', code))
    assert {each for each in DOMAINS if each.startswith("console/")} <= shown <= set(DOMAINS)


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("domain", NAMES)
def test_every_code_has_its_words_and_no_words_are_left_over(domain, language):
    assert keys_of(domain, language) == NAMES[domain]


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("code", REASONS)
def test_every_fact_that_a_reason_names_exists(code, language):
    assert facts_of("reasons", code, language) <= set(REASONS[code])
    facts = {name: "A1" if name.endswith(WORDS) else 3 for name in REASONS[code]}
    said = text("reasons", code, facts, language)
    assert "{" not in said
    assert "?" not in said


def test_a_reason_with_other_facts_is_a_mistake_of_who_gives_it():
    with pytest.raises(ValueError, match="within_buffer with the facts error_mm"):
        reason("within_buffer", error_mm=3)
    with pytest.raises(ValueError, match="no_such_thing"):
        reason("no_such_thing")


def test_figures_as_the_language_writes_them_whatever_the_machine_does(monkeypatch):
    facts = {"error_mm": 4_196, "buffer_mm": 100_000, "significance_milli": 98_712}
    assert (
        text("reasons", "outside_buffer", facts) == "Measured 4.20\u00a0m from the claim, outside 100\u00a0m by 98.7 σ."
    )
    assert "4,20\u00a0m" in text("reasons", "outside_buffer", facts, "fi")
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    assert "2024-11-23 19:10\u00a0UTC" in text("reasons", "maintenance_lapsed", {"until_ms": 1_732_389_000_000})


def test_what_is_not_known_is_said_as_it_is():
    assert text("reasons", "of_a_newer_contract", {"a_mm": 2}) == "of_a_newer_contract (a_mm 2)"
    assert "? from its claim" in text("alerts", "refuted", {"uav_id": "u", "pad_id": "p"})
