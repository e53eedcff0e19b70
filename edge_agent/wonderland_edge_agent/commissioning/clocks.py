"""How far off each anchor's clock is, and how well that is known: from blinks of a tag whose place is known.

When a blink was sent nobody knows; so each stamp is compared with the mean of its frame's, and what is found is how
late an anchor is against the others. That is a constant (cables, antennas, the synchronisation's delay), a slow wander
of the synchronisation about it, which a session of seconds cannot average, and white noise, which it can.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from wonderland.proofs.differences import MIN_ANCHORS
from wonderland.proofs.records.pads import Commissioning
from wonderland_edge_agent.commissioning.curves import ALIKE_S
from wonderland_edge_agent.commissioning.errors import ClockError
from wonderland_edge_agent.commissioning.run import WINDOW_S, Floats, without_bursts
from wonderland_edge_agent.commissioning.spread import inflation
from wonderland_edge_agent.commissioning.stamps import StampedRun

MIN_SECONDS: Final = 20
"""Of frames that all anchors heard: as for ranges."""
MIN_FRAMES: Final = 4
"""In a second that counts."""
MIN_SHARE: Final = 0.5
"""An anchor that heard fewer of the frames shares no clock."""
CLOCK_FLOOR_M: Final = 0.002
"""Nobody claims better clocks: 7 ps."""
STAMP_FLOOR_M: Final = 0.005
"""A tick is 4.7 mm."""
BAD_M: Final = 0.03
BAD_TIMES: Final = 4.0
"""A clock is bad that wanders by more than this, and by so many times what the others do."""
_LEAST_SHARE: Final = 0.5
"""Of the seconds' variance, at least this counts as wander, whatever the noise would explain."""
_OUTLYING: Final = 6.0
MOST_OFFSET_M: Final = 100.0
"""As the record holds."""


@dataclass(frozen=True)
class Clocks:
    """What is known of the clocks of the anchors that share one. Lengths in metres."""

    anchor_ids: tuple[str, ...]
    offset_m: Floats
    """(a,) how late each anchor's stamps are, against the mean of all."""
    sigma_m: Floats
    """(a,) what stays uncertain of that in a session."""
    stamp_sigma_m: float
    """White part of one stamp."""
    frames: int
    t_s: Floats
    """(w,) middle of each second."""
    run: np.ndarray[Any, np.dtype[np.int_]]
    """(w,) which run."""
    wander_m: Floats
    """(w, a) mean of each second, less the offset."""
    bad: tuple[tuple[str, float], ...] = ()
    """Anchors whose clock is much worse than the others', with how much each wanders."""
    without: tuple[str, ...] = ()
    """Anchors of the pad that have no part in the common clock: bad, or deaf."""
    deaf: tuple[str, ...] = ()

    @property
    def usable(self) -> bool:
        """Whether time stamps can be judged at all."""
        return len(self.anchor_ids) >= MIN_ANCHORS

    def notes(self) -> list[tuple[str, str]]:
        """(code, text) of what the operator should know."""
        notes = []
        for name, wander in self.bad:
            after = (
                "it is left out of the common clock; mend its synchronisation and commission again"
                if name in self.without
                else "with four clocks none can be left out; mend its synchronisation and commission again"
            )
            notes.append(("clock_bad", f"Anchor {name}: its clock wanders by {wander * 1000:.0f} mm; {after}."))
        if self.deaf:
            names = ", ".join(self.deaf)
            notes.append(("clock_deaf", f"{names}: stamped fewer than half of the blinks, and shares no clock."))
        if not self.usable:
            notes.append(("clock_few", f"Fewer than {MIN_ANCHORS} anchors share a clock: assurance 2 is the most."))
        if self.run.max() == 0:
            notes.append(
                ("clock_one_run", "One run cannot show what another day changes in the clocks. Add a second run.")
            )
        return notes

    def into(self, record: Commissioning) -> Commissioning:
        """The record with these clocks in it."""
        if not self.usable:
            return record
        place = {name: index for index, name in enumerate(self.anchor_ids)}
        anchors = []
        for anchor in record.anchors:
            index = place.get(anchor.anchor_id)
            if index is None:
                anchors.append(anchor)
                continue
            anchors.append(
                replace(
                    anchor,
                    clock_offset_mm=round(float(self.offset_m[index]) * 1000),
                    clock_sigma_mm=min(max(1, int(np.ceil(float(self.sigma_m[index]) * 1000))), 10_000),
                )
            )
        sigma_mm = min(max(1, round(self.stamp_sigma_m * 1000)), 10_000)
        return replace(record, anchors=tuple(anchors), timestamp_sigma_mm=sigma_mm)

    def document(self) -> dict[str, Any]:
        """For machines, in metres."""
        return {
            "frames": self.frames,
            "stamp_sigma_m": round(self.stamp_sigma_m, 4),
            "anchors": {
                name: {"offset_m": round(float(offset), 4), "sigma_m": round(float(sigma), 4)}
                for name, offset, sigma in zip(self.anchor_ids, self.offset_m, self.sigma_m, strict=True)
            },
            "bad": [name for name, _ in self.bad],
            "without": list(self.without),
        }


def fit_clocks(runs: Sequence[StampedRun]) -> Clocks:
    """Offsets and what remains, of runs at the same anchors. Raises ClockError."""
    names = runs[0].anchor_ids
    heard = np.mean(np.concatenate([np.isfinite(run.late_m) for run in runs]), axis=0)
    deaf = tuple(name for name, share in zip(names, heard, strict=True) if share < MIN_SHARE)
    sharing = [index for index, name in enumerate(names) if name not in deaf]
    if len(sharing) < MIN_ANCHORS:
        raise ClockError(
            f"{', '.join(deaf)}: stamped fewer than half of the blinks; a common clock takes {MIN_ANCHORS} anchors or "
            "more (are their nodes in the session, and do they know UL-TDoA?)"
        )
    found = _fit(runs, sharing)
    bad: list[tuple[str, float]] = []
    while (worst := _worst(found)) is not None:
        bad.append((found.anchor_ids[worst], float(found.sigma_m[worst])))
        if len(sharing) <= MIN_ANCHORS:
            break
        del sharing[worst]
        found = _fit(runs, sharing)
    out = tuple(name for name in names if name not in found.anchor_ids)
    return replace(found, bad=tuple(bad), without=out, deaf=deaf)


def _fit(runs: Sequence[StampedRun], sharing: Sequence[int]) -> Clocks:
    times, owners, means, counts, spreads = [], [], [], [], []
    frames = 0
    for number, run in enumerate(runs):
        late = run.late_m[:, sharing]
        whole = np.isfinite(late).all(axis=1)
        t_s, late = run.t_s[whole], late[whole]
        late = late - late.mean(axis=1, keepdims=True)
        if len(t_s) == 0:
            continue
        bins = np.floor((t_s - t_s[0]) / WINDOW_S).astype(int)
        for rows in np.split(np.arange(len(t_s)), np.flatnonzero(np.diff(bins)) + 1):
            kept, _ = without_bursts(late[rows])
            good = kept[np.isfinite(kept).all(axis=1)]
            if len(good) < MIN_FRAMES:
                continue
            frames += len(good)
            times.append(float(t_s[rows].mean()))
            owners.append(number)
            means.append(good.mean(axis=0))
            counts.append(len(good))
            spreads.append(good.var(axis=0, ddof=1))
    if len(times) < MIN_SECONDS:
        raise ClockError(f"{len(times)} s of blinks that all anchors with a clock stamped; {MIN_SECONDS} are the least")
    seconds = np.array(means)
    count = len(sharing)
    # About the mean of its frame each anchor varies by (a − 1)/a of what it varies by itself.
    white2 = max(float(np.median(np.array(spreads).mean(axis=1))) * count / (count - 1), STAMP_FLOOR_M**2)
    centre = np.median(seconds, axis=0)
    away = np.abs(seconds - centre)
    usual = np.maximum(1.4826 * np.median(away, axis=0), CLOCK_FLOOR_M)
    # A clock that wanders far now and then is bad, not disturbed: its seconds count in what remains uncertain.
    offset = np.average(seconds, axis=0, weights=(away <= _OUTLYING * usual).all(axis=1).astype(float) + 1e-9)
    wander = seconds - offset
    noise2 = white2 * (count - 1) / count / float(np.mean(counts))
    total2 = np.mean(wander**2, axis=0)
    apart = _apart(np.maximum(total2 - noise2, _LEAST_SHARE * total2))
    owner = np.array(owners)
    between2 = np.zeros(count)
    if len(runs) > 1:
        by_run = np.array([wander[owner == number].mean(axis=0) for number in np.unique(owner)])
        between2 = by_run.var(axis=0, ddof=1) * inflation(max(len(by_run) - 1.0, 1.0)) if len(by_run) > 1 else between2
    independent = max(len(times) / ALIKE_S, 2.0)
    sigma2 = np.maximum(apart * inflation(independent) * (1 + 1 / independent), between2)
    sigma = np.sqrt(np.maximum(sigma2, CLOCK_FLOOR_M**2))
    names = tuple(runs[0].anchor_ids[index] for index in sharing)
    return Clocks(names, offset, sigma, float(np.sqrt(white2)), frames, np.array(times), owner, wander)


def _apart(centred2: Floats) -> Floats:
    """Each clock's own variance from those about the mean of all: v = σ²(1 − 2/a) + Σσ²/a²."""
    count = len(centred2)
    total = float(centred2.sum()) / (1 - 1 / count)
    own = (centred2 - total / count**2) / (1 - 2 / count)
    return np.asarray(np.maximum(own, 0.0))


def _worst(found: Clocks) -> int | None:
    """The anchor whose clock is much worse than the others', if one is."""
    worst = int(np.argmax(found.sigma_m))
    others = np.delete(found.sigma_m, worst)
    limit = max(BAD_M, BAD_TIMES * float(np.median(others)))
    return worst if float(found.sigma_m[worst]) > limit else None
