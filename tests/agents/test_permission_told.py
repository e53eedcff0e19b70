"""A drone believes a permission only when the ledger holds it, whatever an event tells (decision 0005)."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import pytest

from wonderland.proof_contract import AwayError, ContractEvent
from wonderland_uav_agent.ledger_events import LedgerEvents
from wonderland_uav_agent.session import events as on


@pytest.fixture
def permitted(make_duo):
    """An honest drone's verdict."""
    duo = make_duo()
    duo.run()
    assert duo.verdict.permission == "granted"
    return duo.verdict


class Ledger:
    """Tells of one decision, and answers with what it holds, or with the errors that stand before it."""

    def __init__(self, told, *answers):
        self.told = told
        self.answers = list(answers)
        self.asked = 0

    async def height(self):
        return 7

    async def events(self, *, start_block=None, names):
        assert start_block == 7
        yield ContractEvent("ProofDecided", "t" * 64, 7, self.told.to_json(), None)
        await asyncio.Event().wait()

    async def read_verdict(self, session_id):
        assert session_id == self.told.session_id
        self.asked += 1
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if isinstance(answer, Exception):
            raise answer
        return answer


async def heard(ledger, *, patience_s=0.3):
    """What a drone hears of its session until nothing more can come."""
    said = asyncio.Queue()
    async with LedgerEvents(ledger, patience_s=patience_s) as events:
        events.listen(ledger.told.session_id, said.put_nowait)
        try:
            async with asyncio.timeout(patience_s + 1):
                return await said.get()
        except TimeoutError:
            return None


async def test_a_permission_that_the_ledger_holds_is_heard(permitted):
    ledger = Ledger(permitted, permitted)
    assert await heard(ledger) == on.VerdictCommitted(permitted, "t" * 64)
    assert ledger.asked == 1


async def test_a_peer_that_is_behind_or_away_is_asked_again(permitted):
    ledger = Ledger(permitted, None, AwayError("gone"), permitted)
    assert await heard(ledger, patience_s=5) == on.VerdictCommitted(permitted, "t" * 64)
    assert ledger.asked == 3


async def test_an_event_without_a_verdict_permits_nothing(permitted, caplog):
    assert await heard(Ledger(permitted, None)) is None
    assert "not believed" in caplog.text


async def test_an_event_that_differs_from_the_verdict_permits_nothing(permitted):
    held = replace(permitted, permission="refused", outcome="refuted")
    assert await heard(Ledger(permitted, held)) is None


async def test_a_refusal_is_believed_at_once(permitted):
    refused = replace(permitted, permission="refused")
    ledger = Ledger(refused, AssertionError("not asked"))
    assert await heard(ledger) == on.VerdictCommitted(refused, "t" * 64)
    assert ledger.asked == 0
