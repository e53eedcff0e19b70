"""The drone's request, while the ledger is away or its peers stand at different blocks."""

from __future__ import annotations

from dataclasses import replace

import pytest

from wonderland.proof_contract import AwayError, Committed, RefusedError
from wonderland.proofs.records.pads import Pad, Prekey
from wonderland_uav_agent import agent as uav
from wonderland_uav_agent.agent import UavAgent


class Asked:
    """A ledger that fails as often as told, then opens the session."""

    channel = "wonderland"

    def __init__(self, session, failures):
        self.session, self.failures = session, list(failures)
        self.requests = 0

    async def list_prekeys(self, pad_id, limit=10):
        return (
            Prekey(
                pad_id=pad_id,
                prekey_id="k1",
                public_key=self.session.pad_key,
                published_ms=1,
                msp_id="PadMSP",
                certificate_sha256="0" * 64,
            ),
        )

    async def read_policy(self, pad_id, action):
        return self.session.policy

    async def request_proof(self, argument):
        self.requests += 1
        if self.failures:
            raise self.failures.pop(0)
        return replace(self.session, uav_key=argument.uav_key), Committed("t" * 64, 5)


class Here:
    def __init__(self, claim):
        self._claim = claim

    def claim(self, now_ms):
        return self._claim


def drone(ledger):
    return UavAgent(
        uav_id="UAV",
        ledger=ledger,
        events=None,
        identity=None,
        signer=None,
        radio=None,
        position=Here(ledger.session.claim),
        act=None,
        clock=lambda: 1,
    )


@pytest.fixture
def session(make_duo):
    return make_duo().session


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(uav, "AWAY_PAUSE_S", 0.0)
    monkeypatch.setattr(uav, "TAKEN_PAUSE_S", 0.0)
    monkeypatch.setattr(uav, "COMMISSIONING_PAUSE_S", 0.0)


async def test_a_ledger_that_is_away_is_waited_for(session):
    ledger = Asked(session, [AwayError("no peer")] * 3)
    opened = (await drone(ledger)._request("pad-1", "land", None, uav.CALM)).session
    assert (opened.session_id, ledger.requests) == (session.session_id, 4)


async def test_what_may_have_been_sent_is_not_asked_for_twice(session):
    ledger = Asked(session, [AwayError("no outcome", "t" * 64)])
    with pytest.raises(AwayError):
        await drone(ledger)._request("pad-1", "land", None, uav.CALM)
    assert ledger.requests == 1


async def test_a_prekey_that_a_peer_does_not_know_yet(session):
    ledger = Asked(session, [RefusedError(404, "PREKEY_UNKNOWN", "none")] * 4)
    await drone(ledger)._request("pad-1", "land", None, uav.CALM)
    assert ledger.requests == 5


async def test_another_refusal_is_final(session):
    ledger = Asked(session, [RefusedError(422, "CLAIM_TOO_OLD", "set the clock")])
    with pytest.raises(RefusedError):
        await drone(ledger)._request("pad-1", "land", None, uav.CALM)
    assert ledger.requests == 1


async def test_the_survey_that_the_session_rests_on_is_waited_for(session, make_duo):
    duo = make_duo()
    pads = [
        Pad(
            pad_id="pad-1",
            msp_id="PadMSP",
            name="Roof",
            operator_id="skyport",
            status="commissioned",
            lat_e7=604_518_000,
            lon_e7=222_666_000,
            height_mm=30_000,
            registered_ms=1,
            updated_ms=1,
            commissioning=duo.commissioning,
            commissioning_sha256=sha256,
        )
        for sha256 in ("0" * 64, "0" * 64, session.commissioning_sha256)
    ]
    ledger = Asked(session, [])

    async def read_pad(_pad_id):
        return pads.pop(0)

    ledger.read_pad = read_pad
    assert await drone(ledger)._commissioning("pad-1", session.commissioning_sha256) == duo.commissioning
    assert pads == []
