"""The air between pads' nodes and what flies: how far it is from one to the other, and what a radio makes of that."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from typing import Final

from wonderland.proofs.errors import GeometryError
from wonderland.proofs.frame import to_local, to_wgs84
from wonderland.proofs.records.sessions import TICKS_PER_SECOND
from wonderland_simulator.attackers.ranging import RANGE_ATTACKS, Situation
from wonderland_simulator.attackers.replay import ReplayAttack
from wonderland_simulator.broadcaster import Fix
from wonderland_simulator.channel import Channel
from wonderland_simulator.flight import Vector
from wonderland_simulator.flyer import Flyer
from wonderland_simulator.scenario import STAMP_SIGMA_M, AnchorSite, PadSite
from wonderland_simulator.uci_node import Air, Measurement

EARSHOT_M: Final = 1_500.0
BLINK_REACH_M: Final = 90.0
BLINK_LOSS: Final = 0.01
DATA_LOSS: Final = 0.02
LIGHT_M_S: Final = 299_792_458.0


def node_name(pad_id: str, anchor_id: str) -> str:
    """What a pad's node is called in the air; a flyer's has the flyer's name."""
    return f"{pad_id}/{anchor_id}"


class PadsAir:
    """``flyers``: by the names of their nodes. ``replaying``: those whose radios answer with what they overheard."""

    def __init__(
        self, pads: Sequence[PadSite], flyers: Mapping[str, Flyer], *, seed: int, replaying: frozenset[str]
    ) -> None:
        self._pads = {pad.pad_id: pad for pad in pads}
        self._frames = {pad.pad_id: pad.frame for pad in pads}
        self._flyers = flyers
        self._channels = {
            pad.pad_id: Channel(
                random.Random(f"{seed}/{pad.pad_id}"), anchor_bias_m={site.mac: site.bias_m for site in pad.anchors}
            )
            for pad in pads
        }
        self._sites = {
            node_name(pad.pad_id, site.anchor_id): (pad.pad_id, site) for pad in pads for site in pad.anchors
        }
        self.moved_m: dict[str, Vector] = {}
        """Pads' nodes that stand elsewhere than their survey has them, and by how much."""
        self._attacks = {
            name: (RANGE_ATTACKS[flyer.attack.ranges], random.Random(f"{seed}/{name}/attack"))
            for name, flyer in flyers.items()
            if flyer.attack is not None and flyer.attack.ranges
        }
        self._drawn: dict[tuple[str, str], tuple[float, Measurement]] = {}
        self._stamp_rng = random.Random(f"{seed}/stamps")
        attack = ReplayAttack(replaying, {name: flyer.pad_id for name, flyer in flyers.items()})
        self.air = Air(
            self.measure,
            rng=random.Random(f"{seed}/air"),
            data_loss=DATA_LOSS,
            intercept=attack.intercept,
            stamp=self._stamp,
            reach=self._reach,
        )

    def hears(self, pad_id: str, sender: Fix) -> bool:
        """Whether a pad's Remote ID receiver is within earshot of a transmitter."""
        try:
            east, north, _ = to_local(self._frames[pad_id], sender.lat_e7, sender.lon_e7, sender.height_mm)
        except GeometryError:
            return False
        return math.hypot(east, north) < EARSHOT_M * 1000

    def measure(self, observer: str, peer: str, t_s: float) -> Measurement:
        """Both ends of a pair report the same draw of a round."""
        pair = (observer, peer) if observer in self._sites else (peer, observer)
        drawn = self._drawn.get(pair)
        if drawn is not None and drawn[0] == t_s:
            return drawn[1]
        if pair[0] not in self._sites:
            return Measurement(None)  # two that fly: no pad's session has both
        pad_id, site = self._sites[pair[0]]
        if pair[1] in self._sites:
            return self._between(pad_id, pair[0], pair[1])
        flyer = self._flyers.get(pair[1])
        here = None if flyer is None else self._seen_from(pad_id, flyer)
        if flyer is None or here is None:
            return Measurement(None)
        result = self._channels[pad_id].measure(math.dist(here, self._stands(pair[0])), site.mac)
        range_m = result.range_m
        if range_m is not None and pair[1] in self._attacks:
            range_m = self._falsified(pad_id, site, pair[1], range_m, t_s)
        measured = Measurement(None if range_m is None else round(range_m * 1000), result.obstructed, result.power_dbm)
        self._drawn[pair] = (t_s, measured)
        return measured

    def _falsified(self, pad_id: str, site: AnchorSite, name: str, range_m: float, t_s: float) -> float | None:
        """What the range becomes where the drone's radio lies about its times; only to the pad that it is about."""
        flyer = self._flyers[name]
        if flyer.claimed_m is None or flyer.pad_id != pad_id:
            return range_m
        range_error, rng = self._attacks[name]
        pad = self._pads[pad_id]
        anchors = [(each.east_m, each.north_m, each.up_m) for each in pad.anchors]
        added = range_error(Situation(flyer.radio_m, flyer.claimed_m, anchors, pad.anchors.index(site), t_s), rng)
        return None if added is None else max(0.0, range_m + added)

    def _stands(self, name: str) -> Vector:
        """Where a pad's node stands, in its pad's frame."""
        _, site = self._sites[name]
        east, north, up = self.moved_m.get(name, (0.0, 0.0, 0.0))
        return (site.east_m + east, site.north_m + north, site.up_m + up)

    def _between(self, pad_id: str, name: str, other_name: str) -> Measurement:
        """Two anchors of a pad range each other; those of another pad are not in its session."""
        other_pad_id, other = self._sites[other_name]
        if pad_id != other_pad_id:
            return Measurement(None)
        distance = math.dist(self._stands(name), self._stands(other_name))
        result = self._channels[pad_id].measure(distance, self._sites[name][1].mac)
        range_m = None if result.range_m is None else result.range_m + other.bias_m
        return Measurement(None if range_m is None else round(range_m * 1000), result.obstructed, result.power_dbm)

    def _stamp(self, anchor: str, tag: str, t_s: float) -> int | None:
        """What the pad's clock shows when the anchor hears a blink: where the drone *is*, whatever its radio says."""
        pad_id, site = self._sites[anchor]
        flyer = self._flyers.get(tag)
        if flyer is None or self._pads[pad_id].clock_sigma_mm is None:
            return None
        here = self._seen_from(pad_id, flyer)
        if here is None:
            return None
        away_m = math.dist(here, self._stands(anchor))
        if away_m > BLINK_REACH_M or self._stamp_rng.random() < BLINK_LOSS:
            return None
        away_m += site.clock_error_m + self._stamp_rng.gauss(0.0, STAMP_SIGMA_M)
        return round(t_s * TICKS_PER_SECOND) + round(away_m / LIGHT_M_S * TICKS_PER_SECOND)

    def _reach(self, receiver: str, sender: str) -> int | None:
        """How far apart two radios are, of whatever pads, as far as they hear each other."""
        pad_id = self._sites[receiver][0] if receiver in self._sites else self._flyers[receiver].pad_id
        places = self._place(pad_id, receiver), self._place(pad_id, sender)
        if places[0] is None or places[1] is None:
            return None
        away_m = math.dist(places[0], places[1])
        return None if away_m > BLINK_REACH_M else round(away_m * 1000)

    def _place(self, pad_id: str, name: str) -> Vector | None:
        """Where a node is, in the frame of any pad; None where that is too far away."""
        if name not in self._sites:
            return self._seen_from(pad_id, self._flyers[name])
        home_id, _ = self._sites[name]
        return self._moved(home_id, self._stands(name), pad_id)

    def _seen_from(self, pad_id: str, flyer: Flyer) -> Vector | None:
        """Where the drone's radio is, in the frame of any pad."""
        return self._moved(flyer.pad_id, flyer.radio_m, pad_id)

    def _moved(self, from_pad: str, place: Vector, to_pad: str) -> Vector | None:
        """From one pad's frame into another's."""
        if from_pad == to_pad:
            return place
        try:
            east, north, up = to_local(
                self._frames[to_pad], *to_wgs84(self._frames[from_pad], *(round(value * 1000) for value in place))
            )
        except GeometryError:
            return None
        return (east / 1000, north / 1000, up / 1000)
