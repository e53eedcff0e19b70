"""What is broadcast under one drone's serial number, and what its pad and the contract make of it.

The drone flies and ranges honestly; only words are on the air: its own Remote ID, and an outsider's. The pad listens as
the real one does (the agent's ``session.broadcasts``), looks as often, and the contract decides with what was attested.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from wonderland.proofs.attestation import digest_of
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import MAX_ATTESTED, BroadcastClaim
from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.stopping import LOOKS
from wonderland.proofs.verdict import decide
from wonderland_edge_agent.session.broadcasts import HeardBroadcasts
from wonderland_research.attack_lab.attacks.common import policy
from wonderland_research.attack_lab.batch import Batch, measured, moving, off, round_times
from wonderland_research.attack_lab.judge import DECIDED_MS, Tally
from wonderland_research.attack_lab.places import SQUARE, START_MS, Floats, directions

EARLIEST_MS, LATEST_MS = -3_000, 10_000
"""What is broadcast before and after the session may be heard as well, ms since the request."""
SECOND_MS: Final = 1_000
LISTEN_MS: Final = 100
HISTORY: Final = 1_200
"""What a receiver remembers of a watched drone."""
LOST: Final = 0.2
"""Share of its own messages that the pad does not hear."""
STATED_MM: Final = (1_000, 3_000, 10_000)
_PER_95: Final = 0.4085
"""Standard deviation on each axis for one unit of a 95 % radius."""
FASTEST_M_S: Final = 2.0


@dataclass(frozen=True)
class Drone:
    """One drone: a straight line, mm and mm/ms."""

    place: Floats
    velocity: Floats

    def at(self, t_ms: float) -> Floats:
        """Where it is, ms after the request."""
        return np.asarray(self.place + self.velocity * t_ms)

    def message(
        self, t_ms: int, shift: Floats | Sequence[float] = (0.0, 0.0, 0.0), *, heard_ms: int, accuracy_mm: int | None
    ) -> BroadcastClaim:
        """A message dated ``t_ms`` that puts it ``shift`` beside its place of then."""
        said_ms = t_ms // 100 * 100
        east, north, up = np.rint(self.at(said_ms) + np.asarray(shift))
        return BroadcastClaim(
            lat_e7=int(north),
            lon_e7=int(east),
            height_mm=int(up),
            t_ms=START_MS + heard_ms,
            said_ms=START_MS + said_ms,
            accuracy_mm=accuracy_mm,
        )


@dataclass(frozen=True)
class OnAir:
    """All that can be heard of one try."""

    own: tuple[BroadcastClaim, ...]
    attested: tuple[str, ...]
    others: tuple[BroadcastClaim, ...] = ()
    lies: frozenset[BroadcastClaim] = frozenset()
    """Which of its own are."""


Own = Callable[[np.random.Generator, Drone], OnAir]
Outsider = Callable[[np.random.Generator, Drone, OnAir], Sequence[BroadcastClaim]]


def honest(rng: np.random.Generator, drone: Drone) -> OnAir:
    """Once a second, as good as it states; every other drone attests what it sends."""
    return said_by(rng, drone, lambda _number: np.zeros(3), attests=bool(rng.random() < 0.5))


def said_by(
    rng: np.random.Generator,
    drone: Drone,
    shift: Callable[[int], Floats],
    *,
    attests: bool,
    stated_mm: int | None = None,
) -> OnAir:
    """What a drone broadcasts once a second, ``shift(number)`` mm beside the truth."""
    stated = int(rng.choice(STATED_MM)) if stated_mm is None else stated_mm
    # A receiver's errors hardly change within seconds: one for the session, which is what it states at 95 %.
    error = rng.normal(0.0, stated * _PER_95, 3) * np.array((1.0, 1.0, 0.0))
    error *= min(1.0, 2.0 * stated / max(float(np.linalg.norm(error)), 1.0))
    heard: list[BroadcastClaim] = []
    lies: set[BroadcastClaim] = set()
    attested: list[str] = []
    for number, t_ms in enumerate(range(EARLIEST_MS + int(rng.integers(0, SECOND_MS)), LATEST_MS, SECOND_MS)):
        message = drone.message(
            t_ms, error + shift(number), heard_ms=t_ms + int(rng.integers(0, 300)), accuracy_mm=stated
        )
        if attests and t_ms >= 0:
            attested.append(digest_of(message) or "")
        if rng.random() >= LOST:
            heard.append(message)
        if shift(number).any():
            lies.add(message)
    return OnAir(tuple(heard), tuple(attested[-MAX_ATTESTED:]), lies=frozenset(lies))


def play(
    own: Own,
    outsider: Outsider | None,
    level: int,
    rng: np.random.Generator,
    count: int,
    *,
    rules: Policy | None = None,
) -> Tally:
    """``count`` tries. With an outsider he wins where a drone is refused that would be permitted without him.

    Without one the drone is the attacker, and wins by any permission although the pad heard it lie meanwhile.
    """
    place, velocity = SQUARE.places(rng, count), directions(rng, count)
    velocity *= rng.uniform(0.0, FASTEST_M_S, count)[:, None]
    truth = place[:, None, :] + velocity[:, None, :] * round_times()[None, :, None]
    claims = moving(place, velocity)
    batch = Batch(SQUARE, claims, measured(rng, SQUARE, truth), off(truth, claims), level, rules or policy(level))
    tally = Tally(tries=count)
    for index in range(count):
        drone = Drone(place[index], velocity[index])
        air = own(rng, drone)
        if outsider is not None:
            air = replace(air, others=tuple(outsider(rng, drone, air)))
        verdict, rounds, told = judged(batch, index, air)
        _count(tally, verdict, rounds)
        granted = verdict.permission == "granted"
        if outsider is None:
            tally.won += granted and any(each in air.lies and each.t_ms >= START_MS for each in told)
        elif not granted:
            alone, *_ = judged(batch, index, replace(air, others=()))
            tally.won += alone.permission == "granted" and heard_itself(alone)
    return tally


def heard_itself(verdict: Verdict) -> bool:
    """Whether the pad heard the drone's own broadcast; one that is not heard can be impersonated."""
    return verdict.broadcast is not None and verdict.broadcast.supported


def judged(batch: Batch, index: int, air: OnAir) -> tuple[Verdict, int, tuple[BroadcastClaim, ...]]:
    """The verdict, after how many rounds the pad asked for it, and which messages it brought."""
    session, on_air = batch.session(index), sorted((*air.own, *air.others), key=lambda each: each.t_ms)
    times = [each.t_ms for each in on_air]
    now = [START_MS]

    def heard(since_ms: int) -> tuple[BroadcastClaim, ...]:
        until = bisect_left(times, now[0])
        return tuple(on_air[max(bisect_left(times, since_ms), until - HISTORY) : until])

    rounds = LOOKS[0]
    pad = HeardBroadcasts(
        session,
        batch.commissioning.frame,
        heard,
        lambda _since_ms: (),
        lambda: (batch.evidence(index, rounds).claims, ()),
    )

    def verdict(attested: tuple[str, ...]) -> Verdict:
        evidence = replace(batch.evidence(index, rounds), broadcast=pad.chosen(attested), attested=attested)
        return decide(
            session,
            batch.commissioning,
            evidence,
            confirmed=True,
            signature_valid=True,
            authorisation=(),
            now_ms=DECIDED_MS,
            evidence_sha256="0" * 64,
        )

    for look in LOOKS:
        rounds = look
        end_ms = START_MS + int(batch.t_ms[look - 1])
        for t_ms in (*range(now[0] + LISTEN_MS, end_ms, LISTEN_MS), end_ms):
            now[0] = t_ms
            pad.listen(START_MS + EARLIEST_MS, t_ms, whole=True)
        seen = verdict(())
        if seen.outcome != "inconclusive" or seen.more_rounds < 0:
            break
    until_ms = now[0]
    said = {digest_of(each) for each in air.own if (each.said_ms or 0) > until_ms}
    attested = tuple(digest for digest in air.attested if digest not in said)
    return verdict(attested), rounds, pad.chosen(attested)


def _count(tally: Tally, verdict: Verdict, rounds: int) -> None:
    tally.decisions += 1
    tally.granted += verdict.permission == "granted"
    tally.open += verdict.outcome == "inconclusive"
    if verdict.outcome == "refuted":
        tally.refuted += 1
        tally.detected_rounds.append(rounds)
        tally.error_refuted_mm.append((verdict.broadcast.error_mm if verdict.broadcast else None) or 0)
    for reason in verdict.reasons:
        tally.reasons[reason.code] = tally.reasons.get(reason.code, 0) + 1
