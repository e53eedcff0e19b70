"""Is the drone where it claims at *every* claimed moment, or only on average: part of step 8 of the verdict.

An estimate is a mean over rounds, and means can be balanced: a drone that tells the truth at some moments and lies at
others, or lies to both sides, keeps its mean claim where it is. So beside the mean stands the **waver**: the root mean
square, over the claimed moments, of claim minus drone about their mean. Where it is small no quarter of the moments can
be two buffers off; where it is not known to be small nothing is verified. A drone cannot jump and its claims can; so a
lie that changes is found in one of these:

- *torn rounds*: in half of the anchors or more the residual leaps, which no radio's error does (``reduction``);
- *unseen claims*: between the rounds, before the first or after the last, off the flight that the rounds' claims show;
- *stretches*: means over stretches of time, which lies that come and go slowly, and a drone that flies while it
  claims to hover, move;
- *motion*: the share of the claimed motion that the ranges do not follow, along the line of sight and across it. Of
  the whole motion it counts where it is clear. Of what no straight flight explains it has to be *proved* small: only
  there can claims hide lies that no mean over a stretch shows, and a far pad measures little of a single one.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt
from typing import Final

from wonderland.proofs.claims import MAX_ACCELERATION_MM_MS2, LocalClaim, Track, track_of
from wonderland.proofs.errors import GeometryError
from wonderland.proofs.estimate import Offset
from wonderland.proofs.fix import MIN_ANCHORS as MIN_FIX_ANCHORS
from wonderland.proofs.fix import Multilateration
from wonderland.proofs.motion import LARGEST_MM, extent_mm, unfollowed_motion
from wonderland.proofs.reduction import AnchorMean, Reduced, Residuals, distance, mean
from wonderland.proofs.sights import Sights
from wonderland.proofs.stretches import swing_of

LIE_SHARE: Final = 0.2
"""No such share of the claimed moments may be ``LIE_BUFFERS`` buffers off or more: a quarter, less what counting blurs,
since a session has ten claims as well as a hundred."""
LIE_BUFFERS: Final = 2.0
MIXED_SHARE: Final = 0.15
"""From this share of torn rounds on the claims contradict one another: their mean refutes nobody either. Of 587 honest
windows on real ranges one in a hundred has so many, and none more than 0.4."""
ROUGH_BUFFERS: Final = 0.5
"""Claims that may jump to and fro by more than this (root mean square) have no mean that could refute."""
QUIET_SHARE: Final = 0.25
"""Claims that spread by less than this share of the buffer hide nothing that could win."""
OFF_BUFFERS: Final = 0.5
"""A torn round is off where what its ranges say lies farther than this from the others."""
JUMP_BUFFERS: Final = 0.25
"""A claim that leaves its flight by more than this from one round to the next, and by more than a drone can, jumps."""
TURNED_BUFFERS: Final = 0.25
"""Where a drone may have turned off by more than this between two rounds, and come back, claims are unseen: with a
buffer for the claim, what the offset leaves of it, and twice this for the way, none that is seen can be two buffers
off."""
LEAP_BUFFERS: Final = 1.5
"""One that does so by more than this leaps, as an honest receiver does for a while."""
LEAP_MS: Final = 2_000
"""So long after a leap nobody is convicted by his claims; what stays off for longer is no glitch."""
SWING_PEAK: Final = 1.414
"""Peak of a swing over its root mean square: √2 for a sine, 1.37 where a drone turns as fast as it can all the time."""
EDGE_MS: Final = 500
"""Over so long the velocity at the first and at the last round is taken."""
_CLEAR_BUFFERS: Final = 0.5
"""Stretches of time are made shorter as long as one by itself is known to this, root mean square."""


@dataclass(frozen=True, slots=True)
class Moments:
    """How the claimed moments lie about what was measured, their mean apart."""

    off_share: float
    """Share of the rounds or of the claims, whichever is more, that contradict the others: torn, or unseen."""
    unseen_share: float
    """Share of the claims that no round saw and no flight explains."""
    waver_mm: float
    """Bound on the root mean square distance of the claims from where the drone was, about their mean."""
    rough_mm: float
    """The part of it that lies in motion which no straight flight explains: claims that go to and fro."""
    jumping: bool
    """Whether the claims jump as no drone can."""
    swing_mm: float = 0.0
    """The part of the waver that comes and goes slowly, root mean square, where it is more than noise."""
    leaping: bool = False
    """Whether they did so just now, by more than any noise: a glitch, or a lie that begins; nobody knows which."""

    def have_a_mean(self, buffer_mm: float) -> bool:
        """Whether the claims agree so far that their mean may speak against the drone.

        Where they jump, and contradict one another or move as the ranges do not, some are wrong and some may be right.
        """
        if self.leaping:
            return False
        return not self.jumping or (self.off_share < MIXED_SHARE and self.rough_mm <= ROUGH_BUFFERS * buffer_mm)

    def reach_mm(self, buffer_mm: float) -> float:
        """How far the mean may be off for a verified claim; the buffer, but where the claims waver; ≤ 0: nothing may.

        Were a quarter of the moments two buffers off, a mean m off, the waver would be √q·(2 − m) buffers or more, q
        the part of that quarter which is not torn and not unseen. A drone that swings is at its farthest as often as
        anywhere, and the place that is certified may be of that moment.
        """
        if self.off_share >= LIE_SHARE:
            return 0.0
        least = sqrt((LIE_SHARE - self.off_share) / (1.0 - self.off_share))
        return min(buffer_mm - SWING_PEAK * self.swing_mm, LIE_BUFFERS * buffer_mm - self.waver_mm / least)


def moments_of(
    reduced: Reduced, offset: Offset, claims: Sequence[LocalClaim], buffer_mm: float, height_mm: float
) -> Moments:
    """Of a session's kept rounds and all of its claims (pad's frame, mm).

    ``buffer_mm`` and ``height_mm``: how far a claim may lie off its flight, on the map and in height.
    """
    seen = reduced.residuals
    if seen is None:  # nothing was ranged: a prospect
        return Moments(0.0, 0.0, 0.0, 0.0, jumping=False)
    quiet_mm = QUIET_SHARE * buffer_mm
    most = extent_mm(seen.claimed, claims)
    slow = swing_of(reduced, offset, seen, _CLEAR_BUFFERS * buffer_mm)
    off = _off_rounds(reduced, offset, seen, OFF_BUFFERS * buffer_mm) if seen.torn else frozenset()
    off_share = len(off) / len(seen.claimed.kept)
    ups = [*seen.claimed.up, *[claim.up for claim in claims]]
    quiet = most <= quiet_mm and max(ups) - min(ups) <= height_mm  # whatever the claims hide is less than could win
    if quiet and _ranged_throughout(seen, TURNED_BUFFERS * buffer_mm):
        return Moments(off_share, 0.0, sqrt(most * most + slow), most, jumping=False, swing_mm=sqrt(slow))
    during, around = _Count(), _Count()
    first_ms, last_ms = seen.span_ms
    held = []
    judged = []
    # The drone of a claim lies off by the mean offset already.
    reach_mm = max(buffer_mm - distance(offset.east, offset.north, 0.0), quiet_mm)
    for claim in claims:
        inside = first_ms <= claim.t_ms <= last_ms
        if not inside and not first_ms - EDGE_MS <= claim.t_ms <= last_ms + EDGE_MS:
            continue  # its moment is not one of the session's rounds: unjudged, like the request's
        judged.append(claim)
        explained = _explained(seen.claimed, claim, reach_mm, height_mm, TURNED_BUFFERS * buffer_mm, ranged=inside)
        torn = explained and bool(off) and _nearest(seen.claimed, claim.t_ms) in off
        around.add(unseen=not explained, torn=torn)
        if inside:
            during.add(unseen=not explained, torn=torn)
            if explained and not torn:
                held.append(claim)
    whole, rough, near = unfollowed_motion(reduced, offset, seen, held, quiet_mm)
    if near:
        rough = max(rough, _by_fixes(reduced, seen))
    moved = max(whole, rough)
    said = track_of(judged)
    return Moments(
        off_share=max(off_share, during.off_share, around.off_share),
        unseen_share=max(during.unseen_share, around.unseen_share),
        waver_mm=sqrt(moved * moved + slow),
        rough_mm=rough,
        swing_mm=sqrt(slow),
        jumping=said.jumps(JUMP_BUFFERS * buffer_mm) or seen.claimed.jumps(JUMP_BUFFERS * buffer_mm),
        leaping=track_of([claim for claim in judged if claim.t_ms >= last_ms - LEAP_MS]).jumps(
            LEAP_BUFFERS * buffer_mm
        ),
    )


@dataclass(slots=True)
class _Count:
    """Claims, and which of them contradict the others."""

    claims: int = 0
    unseen: int = 0
    torn: int = 0

    def add(self, *, unseen: bool, torn: bool) -> None:
        self.claims += 1
        self.unseen += unseen
        self.torn += torn

    @property
    def off_share(self) -> float:
        return (self.unseen + self.torn) / max(self.claims, 1)

    @property
    def unseen_share(self) -> float:
        return self.unseen / max(self.claims, 1)


def _nearest(track: Track, t_ms: int) -> int:
    """The round next to a moment, by its position in the track."""
    after = bisect_right(track.t_ms, t_ms)
    if after == 0:
        return 0
    if after == len(track.t_ms) or t_ms - track.t_ms[after - 1] <= track.t_ms[after] - t_ms:
        return after - 1
    return after


def _ranged_throughout(seen: Residuals, most_mm: float) -> bool:
    """Whether no drone can have turned off by more than this, and come back, between two rounds that count."""
    times = seen.claimed.t_ms
    before, after = times[0] - seen.span_ms[0], seen.span_ms[1] - times[-1]
    longest = max([later - earlier for earlier, later in pairwise(times)], default=0)
    turned = max(longest * longest / 4.0, float(before * before), float(after * after))
    return MAX_ACCELERATION_MM_MS2 * turned / 2.0 <= most_mm


def _explained(
    track: Track, claim: LocalClaim, reach_mm: float, height_mm: float, turned_mm: float, *, ranged: bool
) -> bool:
    """Whether a drone that flew by the rounds' claims can have been at this one, give or take ``reach_mm``.

    Not where the rounds before and after are so far apart that a drone may have turned off and come back: nobody saw.
    ``ranged``: the claim was made while the drone was ranged, so that before the first round that counts, and after the
    last, the same holds.
    """
    times = track.t_ms
    after = bisect_right(times, claim.t_ms)
    if 0 < after < len(times):
        since, until = claim.t_ms - times[after - 1], times[after] - claim.t_ms
        share = since / (since + until)
        east = track.east[after - 1] + (track.east[after] - track.east[after - 1]) * share
        north = track.north[after - 1] + (track.north[after] - track.north[after - 1]) * share
        up = track.up[after - 1] + (track.up[after] - track.up[after - 1]) * share
        turned = MAX_ACCELERATION_MM_MS2 * since * until / 2.0
    else:
        edge = 0 if after == 0 else len(times) - 1
        gap = claim.t_ms - times[edge]
        velocity_east, velocity_north, velocity_up = _edge_velocity(track, edge)
        east, north = track.east[edge] + velocity_east * gap, track.north[edge] + velocity_north * gap
        up = track.up[edge] + velocity_up * gap
        turned = MAX_ACCELERATION_MM_MS2 * gap * gap / 2.0
    if (ranged or 0 < after < len(times)) and turned > turned_mm:
        return False
    if abs(claim.up - up) > height_mm + turned:
        return False
    return distance(claim.east - east, claim.north - north, 0.0) <= reach_mm + turned


def _edge_velocity(track: Track, edge: int) -> tuple[float, float, float]:
    """Claimed velocity (mm/ms) over the rounds next to the first or the last one."""
    times = track.t_ms
    if edge == 0:
        other = min(bisect_right(times, times[0] + EDGE_MS), len(times) - 1)
    else:
        other = max(bisect_right(times, times[-1] - EDGE_MS) - 1, 0)
    span = times[other] - times[edge]
    if span == 0:
        return 0.0, 0.0, 0.0
    return (
        (track.east[other] - track.east[edge]) / span,
        (track.north[other] - track.north[edge]) / span,
        (track.up[other] - track.up[edge]) / span,
    )


def _off_rounds(reduced: Reduced, offset: Offset, seen: Residuals, least_mm: float) -> frozenset[int]:
    """Torn rounds (positions in the claimed track) whose residuals come to an offset that is worth the name.

    Biases that change along a flight tear rounds, too; they come to decimetres.
    """
    means = {column.anchor: mean for column, mean in seen.series}
    order = [anchor.index for anchor in reduced.anchors]
    left = frozenset(seen.track.kept)
    torn = {position: dict[int, float]() for position, moment in enumerate(seen.claimed.kept) if moment not in left}
    for column in seen.raw:
        if column.anchor not in means:
            continue
        for position, value in zip(column.rounds, column.values, strict=True):
            if position in torn:
                torn[position][column.anchor] = value - means[column.anchor]
    off = []
    claimed = seen.claimed
    for position, residuals in torn.items():
        sights = Sights(reduced, offset, claimed.east[position], claimed.north[position], claimed.up[position])
        found = sights.of([residuals.get(anchor) for anchor in order])
        if found is not None:
            fan, values = found
            east, north, _, _ = fan.split(values)
            if distance(east, north, 0.0) <= least_mm:
                continue
        off.append(position)
    return frozenset(off)


def _by_fixes(reduced: Reduced, seen: Residuals) -> float:
    """Root mean square (mm) of each kept round's own fix minus its claim, about their mean: noise included.

    For a drone so near to the anchors that a round knows its place, and directions turn too fast for anything else.
    """
    ranges: dict[int, list[tuple[AnchorMean, float]]] = {}
    track = seen.claimed
    for (column, _), anchor in zip(seen.series, reduced.anchors, strict=True):
        for position, value in zip(column.rounds, column.values, strict=True):
            east, north = track.east[position] - anchor.east, track.north[position] - anchor.north
            expected = distance(east, north, track.up[position] - anchor.up)
            ranges.setdefault(position, []).append((anchor, expected + value))
    offsets = []
    for position, heard in ranges.items():
        if len(heard) < MIN_FIX_ANCHORS:
            continue
        try:
            geometry = Multilateration([(anchor.east, anchor.north, anchor.up) for anchor, _ in heard])
        except GeometryError:
            continue
        found = geometry.fix([range_mm for _, range_mm in heard], track.up[position])
        if found is not None:
            offsets.append((found[0] - track.east[position], found[1] - track.north[position]))
    if 2 * len(offsets) < len(seen.track.kept):
        return LARGEST_MM
    east, north = mean([offset[0] for offset in offsets]), mean([offset[1] for offset in offsets])
    square = 0.0
    for x, y in offsets:
        square += (x - east) * (x - east) + (y - north) * (y - north)
    return sqrt(square / len(offsets))
