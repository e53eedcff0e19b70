"""What receivers of pads find odd about broadcasts, as conditions: each lasts until it was not seen for ten minutes.

Anybody with a transmitter can invent identities; so no more than `SHOWN` drones of a pad have alerts of their own at a
time, and how many there are besides is an alert, too: nothing is left out in silence.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any, Final

import orjson

from wonderland_backend.alerts.conditions import Condition
from wonderland_backend.alerts.queries import Odd

SHOWN: Final = 20
_FACTS: Final = ("distance_mm", "interval_ms", "other_uav_id")

IDENTITY: Final = frozenset({"two_places", "impossible_speed", "time_backwards", "several_identities", "signature_bad"})
"""Kinds that tell of a false identity or of a replay; the others may be no more than a bad clock or radio."""


def conditions(found: Sequence[Odd]) -> Iterable[Condition]:
    """Those of the first drones of each pad, and of each pad how many there are besides."""
    drones: defaultdict[str, dict[str, None]] = defaultdict(dict)
    for each in found:
        drones[each.pad_id][each.uav_id] = None
    shown = {pad_id: set(list(its)[:SHOWN]) for pad_id, its in drones.items()}
    for each in found:
        if each.uav_id not in shown[each.pad_id]:
            continue
        kind = "identity_odd" if each.kind in IDENTITY else "broadcast_odd"
        key = f"{each.pad_id}/{each.uav_id}/{each.kind}"
        yield Condition(kind, key, each.t_ms, each.pad_id, _facts(each), each.uav_id)
    for pad_id, its in drones.items():
        if len(its) > SHOWN:
            t_ms = max(each.t_ms for each in found if each.pad_id == pad_id)
            yield Condition("broadcasts_flooded", pad_id, t_ms, pad_id, {"drones": len(its)})


def _facts(each: Odd) -> dict[str, Any]:
    body = orjson.loads(each.body)
    return {"finding": each.kind, **{name: body[name] for name in _FACTS if body.get(name) is not None}}
