"""What of a flood goes into the record: what the drone attested, what is nearest to its path, and the newest."""

from __future__ import annotations

import pytest
from kit.proof_world import START_MS, World

from wonderland.proofs.attestation import digest_of
from wonderland.proofs.records.sessions import MAX_CLAIMS, BroadcastClaim
from wonderland_edge_agent.session.broadcasts import NEAREST, HeardBroadcasts


def path(t):
    return (3000 + 2 * t, 6000, 4000)


class Flooded:
    """A drone that flies at 2 m/s, and everything that is broadcast under its serial number."""

    def __init__(self, ahead_ms=0):
        self.world = World()
        self.now_ms = START_MS
        self.air: list[BroadcastClaim] = []
        self.ambiguous: list[BroadcastClaim] = []
        self.ahead_ms = ahead_ms
        self.heard = HeardBroadcasts(
            self.world.session(self.world.claim(path(0), START_MS)),
            self.world.commissioning.frame,
            lambda since_ms: tuple(one for one in self.air[-1_200:] if one.t_ms >= since_ms),
            lambda since_ms: tuple(self.ambiguous),
            self._said,
        )

    def _said(self):
        times = range(0, self.now_ms - START_MS + 1, 200)
        return tuple(self.world.claim(path(t), START_MS + t) for t in times), ()

    def message(self, t, east_mm=0, accuracy_mm=None):
        east, north, up = path(t)
        place = self.world.claim((east + east_mm, north, up), 0)
        return BroadcastClaim(
            lat_e7=place.lat_e7,
            lon_e7=place.lon_e7,
            t_ms=START_MS + t,
            said_ms=START_MS + t // 100 * 100,
            accuracy_mm=accuracy_mm,
        )

    def play(self, seconds, flood, *, own=None):
        """``flood(t)``: what an outsider sends in each millisecond; ``own(t)``: what the drone sends each second."""
        sent = []
        for t in range(seconds * 1_000):
            self.now_ms = START_MS + t
            self.air += flood(t)
            if own is not None and t % 1_000 == 500:
                sent.append(own(t))
                self.air.append(sent[-1])
            if t % 50 == 0:
                self.heard.listen(START_MS - 3_000, self.now_ms)
        self.heard.listen(START_MS - 3_000, self.now_ms, whole=True)
        return sent


@pytest.mark.parametrize(
    ("east_mm", "accuracy_mm"), [(36_000, None), (1_500, None), (1_010, None), (2_000, 900), (45_000, 20_000)]
)
@pytest.mark.parametrize("attests", [True, False])
def test_the_drones_own_messages_are_in_the_record(east_mm, accuracy_mm, attests):
    air = Flooded()
    own = air.play(8, lambda t: [air.message(t, east_mm, accuracy_mm)], own=lambda t: air.message(t, 200, 3_000))
    chosen = air.heard.chosen([digest_of(one) for one in own] if attests else ())
    assert len(chosen) == MAX_CLAIMS
    assert set(own) <= set(chosen)
    assert list(chosen) == sorted(chosen, key=lambda one: one.t_ms)
    assert len([one for one in chosen if one not in own]) >= MAX_CLAIMS - NEAREST, "the record shows the flood, too"


def test_of_an_attested_message_that_is_repeated_a_thousand_times_there_is_one():
    air = Flooded()
    truth = air.message(400, 0)
    lie = air.message(400, 9_000)

    def repeated(t):
        return [BroadcastClaim(**{**one.to_json(), "t_ms": START_MS + t}) for one in (truth, lie)] if t > 400 else []

    air.play(5, repeated)
    chosen = air.heard.chosen([digest_of(truth), digest_of(lie)])
    assert {digest_of(one) for one in chosen} == {digest_of(truth), digest_of(lie)}
    assert min(one.t_ms for one in chosen if digest_of(one) == digest_of(lie)) < START_MS + 5_000


def test_nothing_is_lost_and_nothing_twice_while_little_is_sent():
    air = Flooded()
    own = air.play(8, lambda t: [air.message(t, 36_000)] if t % 100 == 7 else [], own=air.message)
    chosen = air.heard.chosen(())
    assert len(chosen) == len(set(chosen)) == 88
    assert set(own) <= set(chosen)


def test_two_messages_of_one_moment_are_both_taken_even_if_the_second_comes_later():
    air = Flooded()
    air.now_ms = START_MS + 500
    air.air.append(air.message(500))
    air.heard.listen(START_MS, air.now_ms)
    air.air.append(air.message(500, 36_000))
    air.heard.listen(START_MS, air.now_ms, whole=True)
    assert len(air.heard.chosen(())) == 2


def test_messages_of_a_transmitter_with_several_names_count_where_the_drone_attested_them():
    air = Flooded()
    own, other = air.message(500), air.message(600, 36_000)
    air.ambiguous += [own, other]
    assert air.heard.chosen(()) == ()
    assert air.heard.chosen([digest_of(own)]) == (own,)
