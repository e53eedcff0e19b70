"""Who is in the world of the demo: three landing pads, honest drones, and liars of each kind.

The sites are in Turku; `wonderland_simulator.scenarios` has the same drones elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning, Frame
from wonderland.uwb.agreed import ability_of
from wonderland_edge_agent.geodesy import frame_at
from wonderland_simulator.channel import BIAS_M
from wonderland_simulator.uci_node.profiles import DWM3001CDK, PROFILES, SR150, NodeProfile

DWM1001: Final = "DWM1001"
"""The paper's boards, which do not speak UCI."""
DAY_MS: Final = 86_400_000
STAMP_SIGMA_M: Final = 0.03
"""White error of one time stamp, as a length: 100 ps."""


class Behaviour(StrEnum):
    """What a drone does that an honest one would not."""

    HONEST = "honest"
    GNSS_DRAGGED = "gnss-dragged"
    """A spoofer drags its position away at 1 m/s; it believes what it signs and broadcasts."""
    FALSE_BROADCAST = "false-broadcast"
    """It tells the pad the truth and the public another place."""
    REPLAY = "replay"
    """Its radio answers with frames of a session that it overheard."""
    MAINTENANCE_LAPSED = "maintenance-lapsed"
    """It is where it says, but may not fly."""
    ATTACK = "attack"
    """One of the attack lab's: what it does is in its spec's ``attack``."""


@dataclass(frozen=True)
class AnchorSite:
    """One node of a pad: its place in metres, its constant range error, its short address."""

    anchor_id: str
    mac: int
    east_m: float
    north_m: float
    up_m: float
    bias_m: float
    clock_error_m: float = 0.0
    """How late its time stamps are on the pad's common clock, as a length."""


@dataclass(frozen=True)
class PadSite:
    """One landing pad.

    ``buffer_mm`` is the buffer of its policy. ``clock_sigma_mm``: how well its nodes' common clock was commissioned;
    None where they have none. ``dock_assurance``: what its policy demands of a drone that docks; ``witness_pad_id``:
    the pad that it then names as witness. ``profile``: its boards' kind, where it is another than its clocks demand.
    """

    pad_id: str
    name: str
    lat_e7: int
    lon_e7: int
    height_mm: int
    anchors: tuple[AnchorSite, ...]
    buffer_mm: int = 1_000
    clock_sigma_mm: int | None = None
    dock_assurance: int | None = None
    witness_pad_id: str | None = None
    profile: str = ""

    @property
    def board(self) -> NodeProfile:
        """The boards of the pad and of the drones that it serves: they time-stamp one way only where that is needed."""
        if self.profile:
            return PROFILES[self.profile]
        return DWM3001CDK if self.clock_sigma_mm is None else SR150

    @property
    def frame(self) -> Frame:
        """The pad's local frame."""
        return frame_at(self.lat_e7, self.lon_e7, self.height_mm)

    def commissioning(self, now_ms: int, *, sigma_mm: int = 30) -> Commissioning:
        """What a good commissioning of this pad would have found: biases to 6 mm, positions to 3 mm."""
        return Commissioning(
            frame=self.frame,
            anchors=tuple(
                Anchor(
                    anchor_id=site.anchor_id,
                    mac=site.mac,
                    east_mm=round(site.east_m * 1000),
                    north_mm=round(site.north_m * 1000),
                    up_mm=round(site.up_m * 1000),
                    survey_sigma_mm=3,
                    bias=tuple(
                        BiasPoint(
                            range_mm=round(distance * 1000),
                            bias_mm=round((bias + site.bias_m) * 1000),
                            sigma_mm=6,
                        )
                        for distance, bias in BIAS_M
                    ),
                    clock_offset_mm=None if self.clock_sigma_mm is None else 0,
                    clock_sigma_mm=self.clock_sigma_mm,
                )
                for site in self.anchors
            ),
            range_sigma_mm=sigma_mm,
            installation_sigma_mm=8,
            max_range_mm=80_000,
            valid_from_ms=now_ms - DAY_MS,
            valid_until_ms=now_ms + 365 * DAY_MS,
            method="Simulated survey and calibration",
            timestamp_sigma_mm=None if self.clock_sigma_mm is None else round(STAMP_SIGMA_M * 1000),
            nodes=None if self.profile == DWM1001 else ability_of(self.board.said()),
        )


@dataclass(frozen=True)
class AttackSpec:
    """What a drone of the attack lab does. Lengths in metres, in the pad's frame.

    ``lie_m``: claim minus truth; ``lie_share``: in how many of its fixes. ``spoofed_m``: its GNSS is shifted by that,
    so that it hovers beside its hover. ``drag_m_s``: its GNSS is dragged away from when it sets out. ``ranges``: one of
    ``attackers.ranging.RANGE_ATTACKS``. ``accuracy_m``, ``height_accuracy_m``: what it claims to know.
    ``mirrored``: it claims the place opposite, seen from the pad's middle.
    ``accomplice``: the radio that answers with its keys is a second drone's, which is where it claims to be.
    """

    name: str
    lie_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lie_share: float = 1.0
    spoofed_m: tuple[float, float] = (0.0, 0.0)
    drag_m_s: float = 0.0
    ranges: str = ""
    accuracy_m: float | None = None
    height_accuracy_m: float | None = None
    accomplice: bool = False
    mirrored: bool = False


@dataclass(frozen=True)
class DroneSpec:
    """One drone: where it goes, how good its GNSS is, how it lies."""

    uav_id: str
    model: str
    pad_id: str
    action: str
    behaviour: Behaviour
    hover_m: tuple[float, float, float]
    """Where it asks for its proof, in the pad's frame."""
    away_m: tuple[float, float, float]
    """Where it comes from and goes back to."""
    start_s: float
    """When it first sets out."""
    gnss_sigma_m: float = 0.02
    attack: AttackSpec | None = None
    impostor_m: tuple[float, float] | None = None
    """How far from its hover (east, north) somebody else broadcasts its serial number while it is about."""
    corridor_m: tuple[tuple[float, float, float], ...] = ()
    """Where it flies on its way in, and in the opposite order on its way out."""

    @property
    def honest(self) -> bool:
        """Whether a good verdict is expected."""
        return self.behaviour is Behaviour.HONEST


def square(
    first_mac: int, half_m: float, biases: tuple[float, ...], clocks: tuple[float, ...] = (0.0,) * 4, raised: int = 0
) -> tuple[AnchorSite, ...]:
    """Four anchors at the corners of a square: first address, half a side, range errors, clock errors.

    ``raised``: which corner is higher, from north-east counter-clockwise. Time differences alone prove a place in the
    quarters beside it; towards it, and away from it, four anchors leave a second place that fits.
    """
    corners = ((half_m, half_m), (-half_m, half_m), (-half_m, -half_m), (half_m, -half_m))
    # One raised anchor: four in a plane could not tell above from below.
    return tuple(
        AnchorSite(
            f"A{index + 1}",
            first_mac + index,
            east,
            north,
            1.6 if index == raised else 0.25,
            biases[index],
            clocks[index],
        )
        for index, (east, north) in enumerate(corners)
    )


PADS: Final = (
    PadSite(
        "aurajoki-2", "Aurajoki 2", 604_503_100, 222_712_400, 31_000, square(0xA000, 1.6, (0.02, -0.01, 0.0, 0.015))
    ),
    PadSite(
        "satama-1",
        "Satama 1",
        604_360_800,
        222_308_900,
        24_000,
        square(0xA010, 4.0, (-0.02, 0.01, 0.02, 0.0), (0.003, -0.004, 0.001, 0.0)),
        clock_sigma_mm=4,
        dock_assurance=3,
    ),
    PadSite(
        "kupittaa",
        "Kupittaa",
        604_484_900,
        222_968_700,
        47_000,
        square(0xA020, 2.0, (0.0, 0.0, -0.015, 0.02)),
        buffer_mm=3_000,
    ),
)

DRONES: Final = (
    DroneSpec(
        "OH-DRN-0233", "Heavylift X8", "aurajoki-2", "land", Behaviour.HONEST, (5.5, -6.5, 6.0), (160, -240, 60), 0.0
    ),
    DroneSpec("OH-DRN-0377", "Parcel M4", "satama-1", "land", Behaviour.HONEST, (-7.0, 4.0, 5.0), (-260, 120, 55), 0.5),
    DroneSpec(
        "OH-DRN-0118", "Survey S2", "kupittaa", "land", Behaviour.HONEST, (6.0, 6.0, 6.0), (210, 190, 50), 1.0, 0.25
    ),
    DroneSpec(
        "OH-DRN-0417", "Parcel M4", "aurajoki-2", "land", Behaviour.GNSS_DRAGGED, (2.0, 9.5, 6.5), (60, 300, 70), 7.0
    ),
    DroneSpec(
        "OH-DRN-0640", "Parcel M4", "kupittaa", "dock", Behaviour.FALSE_BROADCAST, (-6.5, 5.0, 5.5), (-300, 90, 65), 7.5
    ),
    DroneSpec("OH-DRN-0871", "Courier C1", "satama-1", "land", Behaviour.REPLAY, (6.0, 7.0, 5.0), (240, 200, 45), 8.0),
    DroneSpec(
        "OH-DRN-0925",
        "Courier C1",
        "kupittaa",
        "land",
        Behaviour.MAINTENANCE_LAPSED,
        (4.0, -8.0, 6.0),
        (120, -280, 60),
        13.0,
    ),
    DroneSpec(
        "OH-DRN-0102", "Heavylift X8", "satama-1", "dock", Behaviour.HONEST, (5.0, -7.0, 6.0), (150, -260, 70), 13.5
    ),
    DroneSpec(
        "OH-DRN-0559",
        "Courier C1",
        "satama-1",
        "dock",
        Behaviour.ATTACK,
        (-4.0, 6.5, 5.0),
        (-200, 210, 60),
        16.5,
        attack=AttackSpec("time stamps falsified for each anchor", lie_m=(3.5, -1.0, 0.0), ranges="per-anchor"),
    ),
    DroneSpec(
        "OH-DRN-0736",
        "Survey S2",
        "aurajoki-2",
        "land",
        Behaviour.ATTACK,
        (-0.5, -9.5, 6.0),
        (-60, -300, 55),
        19.0,
        attack=AttackSpec("a lie in two of five claims", lie_m=(7.5, 0.0, 0.0), lie_share=0.4),
    ),
    DroneSpec(
        "OH-DRN-0281",
        "Heavylift X8",
        "aurajoki-2",
        "land",
        Behaviour.HONEST,
        (-5.5, 6.5, 6.0),
        (-170, 240, 60),
        13.0,
        impostor_m=(-30.0, 20.0),
    ),
)
FALSE_BROADCAST_M: Final = (22.0, 21.0)
"""How far OH-DRN-0640's broadcast lies from where it is: east, north."""
