"""What a gatekeeper orders: a vehicle that obeys at once, a pilot, a fail-safe, and liars about the permission."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from wonderland.proofs.frame import to_local, to_wgs84
from wonderland.proofs.records.sessions import Claim
from wonderland_edge_agent.geodesy import frame_at
from wonderland_uav_agent.flight import FlightSettings, Gate, Gatekeeper
from wonderland_uav_agent.flight.approach import GoTo, Land, Phase, Prove, Report, Return, Tell
from wonderland_uav_agent.flight.gatekeeper import AGAIN_MS, GATE_PATIENCE_MS
from wonderland_uav_agent.flight.settings import Alternate
from wonderland_uav_agent.flight.vehicle import ARDUPILOT, PX4, Mode, Vehicle, mode_of
from wonderland_uav_agent.position.mavlink.messages import Heartbeat

FRAME = frame_at(604_518_000, 222_666_000, 30_000)
PAD = Gate("pad-1", FRAME)
FAR_PAD = Gate("pad-2", frame_at(604_618_000, 222_666_000, 30_000))
NUMBERS = {Mode.HELD: 4, Mode.LANDING: 9, Mode.RETURNING: 6, Mode.MISSION: 3, Mode.OTHER: 5}


class Drone:
    """Flies as it is told, in 100 ms looks, and notes what it is told."""

    def __init__(self, settings=None, *, obeys=True):
        self.keeper = Gatekeeper(settings or FlightSettings())
        self.keeper.know([PAD, FAR_PAD])
        self.local = [3_000, 0, 25_000]
        self.mode = Mode.MISSION
        self.armed, self.on_ground, self.failsafe, self.down, self.obeys = True, False, False, 0, obeys
        self.now_ms = 1_000_000
        self.orders = []
        self.told_mode = None

    @property
    def seen(self):
        """What is known of it; its mode may be an old one."""
        lat, lon, height = to_wgs84(FRAME, *self.local)
        claim = Claim(
            lat_e7=lat, lon_e7=lon, height_mm=height, accuracy_mm=500, height_accuracy_mm=500, t_ms=self.now_ms
        )
        return Vehicle(
            stack=ARDUPILOT,
            mode=self.told_mode or self.mode,
            custom_mode=NUMBERS[self.told_mode or self.mode],
            armed=self.armed,
            on_ground=self.on_ground,
            landing=self.mode is Mode.LANDING,
            failsafe=self.failsafe,
            claim=claim,
            alt_mm=height - 19_000,
            speed_mm_s=abs(self.down),
            down_mm_s=self.down,
        )

    def obey(self, orders):
        self.orders += orders
        for order in orders if self.obeys else ():
            if isinstance(order, GoTo):
                self.mode, self.down = Mode.HELD, 0
                self.going = order
            elif isinstance(order, Land):
                self.mode, self.down = Mode.LANDING, 700
            elif isinstance(order, Return):
                self.mode = Mode.RETURNING

    def look(self, count=1):
        for _ in range(count):
            self.now_ms += 100
            self.obey(self.keeper.look(self.seen, self.now_ms))

    def arrive(self):
        self.local = [0, 0, 8_000]
        self.look()

    def kinds(self):
        return [type(order) for order in self.orders if not isinstance(order, Tell)]

    def told(self):
        return [order.text for order in self.orders if isinstance(order, Tell)]

    def to_proof(self):
        self.mode, self.down = Mode.LANDING, 700
        self.look(2)
        self.arrive()
        assert self.keeper.phase is Phase.PROVING
        return self

    def ended(self, why_not):
        self.obey(self.keeper.proof_ended(why_not, self.seen, self.now_ms))

    def permit(self, pad_id="pad-1"):
        why_not, orders = self.keeper.permit(pad_id, self.seen, self.now_ms)
        self.obey(orders)
        return why_not


def stands(drone, *, for_ms=10_000, above_mm=100):
    """Down by permission, with an autopilot that notices nothing."""
    drone.to_proof()
    assert drone.permit() == ""
    drone.look(10)
    drone.local, drone.down = [400, -300, above_mm], 0
    drone.look(for_ms // 100)
    return drone


def test_one_that_stands_unnoticed_is_down_and_no_permission_that_ends_lifts_it_again():
    drone = stands(Drone())
    assert not drone.keeper.landing
    assert drone.keeper.revoke("the session ended", drone.seen, drone.now_ms) == []
    before = list(drone.orders)
    drone.look(600)
    assert drone.orders == before, "a minute later"
    drone.armed = False
    drone.look()
    assert drone.keeper.phase is Phase.WATCHING
    assert Report not in drone.kinds()


@pytest.mark.parametrize("while_it", ["has just come down", "waits halfway", "sinks slowly", "slides"])
def test_one_that_does_not_stand_is_still_held_to_its_permission(while_it):
    for_ms = 3_000 if while_it == "has just come down" else 10_000
    drone = stands(Drone(), for_ms=0, above_mm=4_000 if while_it == "waits halfway" else 1_000)
    drone.down = {"sinks slowly": 100, "slides": 400}.get(while_it, 0)
    drone.look(for_ms // 100)
    assert drone.keeper.landing
    drone.obey(drone.keeper.revoke("the session ended", drone.seen, drone.now_ms))
    assert (drone.kinds()[-1], drone.keeper.phase) == (GoTo, Phase.REFUSED)


@pytest.mark.parametrize("lands", [Mode.LANDING, Mode.RETURNING])
def test_who_took_off_from_there_again_needs_another_permission(lands):
    drone = stands(Drone())
    drone.mode, drone.down, drone.local = Mode.OTHER, -1_000, [0, 0, 9_000]
    drone.look(20)
    assert drone.keeper.phase is Phase.WATCHING
    drone.mode, drone.down = lands, 700
    drone.look()
    assert (drone.kinds()[-1], drone.keeper.phase) == (GoTo, Phase.TO_GATE)


@pytest.mark.parametrize("mode", [Mode.LANDING, Mode.RETURNING, Mode.MISSION])
def test_who_begins_to_land_near_a_pad_is_held_above_it_until_a_verdict_permits(mode):
    drone = Drone()
    drone.look(20)
    assert drone.orders == [], "a mission that passes by is left alone"
    drone.mode, drone.down, drone.local = mode, 700, [12_000, -9_000, 14_000]
    drone.look()
    assert drone.kinds() == [GoTo]
    assert drone.going == GoTo(*to_wgs84(FRAME, 0, 0, 8_000))
    drone.look(10)
    assert drone.kinds() == [GoTo], "obeyed, so not told again; not there, so no proof yet"
    drone.arrive()
    assert drone.kinds() == [GoTo, Prove]
    drone.look(600)
    assert drone.kinds() == [GoTo, Prove], "nothing but a verdict lets it land"
    assert drone.permit() == ""
    assert drone.kinds() == [GoTo, Prove, Land]
    drone.look(30)
    drone.on_ground = True
    drone.look()
    assert drone.keeper.phase is Phase.WATCHING
    assert not any(isinstance(order, Report) for order in drone.orders)


@pytest.mark.parametrize(
    ("local", "mode", "down"),
    [
        ([25_000, 0, 10_000], Mode.LANDING, 700),
        ([0, 0, 10_000], Mode.MISSION, 100),
        ([0, 0, 30_000], Mode.RETURNING, 2_000),
        ([0, 0, 10_000], Mode.OTHER, 1_500),
    ],
)
def test_what_is_no_landing_at_a_pad_is_left_alone(local, mode, down):
    drone = Drone()
    drone.local, drone.mode, drone.down = local, mode, down
    drone.look(50)
    assert drone.orders == []


def test_refused_it_tries_as_often_as_it_was_told_and_then_holds():
    drone = Drone(FlightSettings(attempts=2)).to_proof()
    drone.ended("refuted: the ranges contradict the claim")
    drone.look(20)
    assert drone.kinds() == [GoTo, Prove], "not at once"
    drone.look(AGAIN_MS // 100)
    assert drone.kinds() == [GoTo, Prove, Prove]
    drone.ended("refuted again")
    drone.look(600)
    assert drone.kinds() == [GoTo, Prove, Prove, GoTo]
    assert drone.keeper.phase is Phase.REFUSED
    assert drone.told()[-1] == "no permission to land at pad-1: refuted again; holding"
    assert drone.permit() == "", "a proof that somebody asked for can still permit it"
    assert drone.kinds()[-1] is Land


def test_refused_it_returns_and_is_not_landed_at_the_same_pad_by_that_name():
    drone = Drone(FlightSettings(attempts=1, refused="return")).to_proof()
    drone.ended("refuted")
    assert drone.kinds()[-1] is Return
    drone.look(10)
    drone.down = 900
    drone.look()
    assert drone.kinds()[-1] is GoTo, "launch is this very pad"
    assert drone.told()[-1] == "returning would land at pad-1: holding"
    elsewhere = Drone(FlightSettings(attempts=1, refused="return")).to_proof()
    elsewhere.ended("refuted")
    elsewhere.local = [40_000, 0, 20_000]
    elsewhere.look()
    assert elsewhere.keeper.phase is Phase.WATCHING


def test_refused_it_goes_to_its_alternate():
    place = Alternate(lat=60.4530, lon=22.2670, height_m=55.0)
    drone = Drone(FlightSettings(attempts=1, refused="alternate", alternate=place)).to_proof()
    drone.ended("refuted")
    drone.local = [40_000, 60_000, 20_000]
    drone.look(100)
    assert drone.orders[-1] == GoTo(604_530_000, 222_670_000, 55_000)


@pytest.mark.parametrize("mode", [Mode.OTHER, Mode.LANDING, Mode.RETURNING])
def test_the_pilot_always_wins_and_a_landing_without_permission_is_told(mode):
    drone = Drone().to_proof()
    drone.mode = mode
    drone.look()
    assert drone.keeper.phase is Phase.OVERRIDDEN
    before = drone.kinds()
    assert drone.permit().startswith("overridden: the pilot")
    drone.ended("refuted")
    drone.look(100)
    assert drone.kinds() == before, "nothing more is ordered"
    drone.on_ground = True
    drone.look(2)
    (report,) = (order for order in drone.orders if isinstance(order, Report))
    assert report == Report("pad-1", "pilot", "on the ground at pad-1 without a permission: the pilot flies")
    drone.on_ground, drone.mode = False, Mode.MISSION
    drone.look(10)
    assert drone.keeper.phase is Phase.WATCHING, "the next flight is another one"


def test_a_failsafe_is_never_held():
    drone = Drone()
    drone.mode, drone.failsafe, drone.down = Mode.LANDING, True, 700
    drone.look(50)
    assert drone.kinds() == []
    held = Drone().to_proof()
    held.mode, held.failsafe = Mode.LANDING, True
    held.look(50)
    assert held.kinds() == [GoTo, Prove]
    assert held.keeper.why == "a fail-safe of the autopilot flies"
    held.on_ground = True
    held.look()
    assert held.orders[-1].cause == "failsafe"


def test_the_pilot_takes_over_while_it_lands_and_the_permission_is_not_used_up_by_the_agent():
    drone = Drone().to_proof()
    drone.permit()
    drone.look(20)
    drone.mode = Mode.OTHER
    drone.look()
    assert drone.keeper.phase is Phase.OVERRIDDEN
    drone.on_ground = True
    drone.look()
    assert not any(isinstance(order, Report) for order in drone.orders), "the ledger permitted that landing"


def test_a_pilot_whose_permission_ends_before_he_is_down_had_none():
    drone = Drone().to_proof()
    drone.permit()
    drone.look(20)
    drone.mode = Mode.OTHER
    drone.look()
    before = drone.kinds()
    drone.obey(drone.keeper.revoke("the session ended", drone.seen, drone.now_ms))
    assert drone.kinds() == before
    drone.on_ground = True
    drone.look()
    assert drone.orders[-1].cause == "pilot"


def test_a_permission_that_ends_while_nobody_knows_where_it_is_holds_it_when_it_is_known():
    """Who jams the receiver at that moment wins no landing by it."""
    drone = Drone().to_proof()
    drone.permit()
    drone.look(20)
    assert drone.keeper.revoke("the session ended", None, drone.now_ms) == []
    drone.look()
    assert drone.kinds()[-1] is GoTo
    assert drone.keeper.phase is Phase.REFUSED
    down = Drone().to_proof()
    down.permit()
    down.keeper.revoke("the session ended", None, down.now_ms)
    down.on_ground = True
    down.look()
    assert isinstance(down.orders[-1], Report)


def test_an_order_without_effect_is_given_again_and_is_no_pilots_will():
    drone = Drone(obeys=False)
    drone.mode, drone.down = Mode.LANDING, 700
    drone.look(1 + 3 * AGAIN_MS // 100)
    assert drone.kinds() == [GoTo] * 4
    assert drone.keeper.phase is Phase.TO_GATE
    drone.on_ground = True
    drone.look()
    assert drone.orders[-1].cause == "not_held"


def test_a_landing_that_is_known_before_its_mode_is_no_pilots_will():
    drone = Drone()
    drone.mode, drone.told_mode, drone.down, drone.obeys = Mode.LANDING, Mode.MISSION, 700, False
    drone.look(2)
    assert drone.kinds() == [GoTo], "it says that it lands; the mode that it told a second ago is another"
    drone.told_mode = None
    drone.look(5)
    assert drone.keeper.phase is Phase.TO_GATE
    drone.obeys = True
    drone.look(AGAIN_MS // 100)
    assert (drone.mode, drone.keeper.phase) == (Mode.HELD, Phase.TO_GATE)
    drone.look(2)
    drone.mode = Mode.LANDING
    drone.look()
    assert drone.keeper.phase is Phase.OVERRIDDEN, "it had obeyed: this is somebody's will"


def test_wind_that_keeps_it_from_the_gate_does_not_keep_it_from_its_proof():
    drone = Drone()
    drone.mode, drone.down = Mode.LANDING, 700
    drone.look(2)
    drone.local, drone.down = [5_000, 0, 8_000], 0
    drone.look(GATE_PATIENCE_MS // 100)
    assert drone.kinds() == [GoTo, Prove]


def test_a_permission_for_another_pad_or_from_afar_moves_nothing():
    drone = Drone().to_proof()
    assert drone.permit("pad-2") == "the drone is not above pad pad-2"
    assert drone.permit("pad-3") == "the drone is not above pad pad-3"
    assert Land not in drone.kinds()
    assert drone.keeper.permit("pad-1", None, drone.now_ms) == ("the autopilot does not say where it is", [])


def test_a_permission_that_was_asked_for_elsewhere_brings_it_above_the_pad_first():
    drone = Drone()
    drone.local, drone.mode = [9_000, 0, 12_000], Mode.HELD
    assert drone.permit() == ""
    drone.look(20)
    assert drone.kinds() == [GoTo]
    drone.arrive()
    assert drone.kinds() == [GoTo, Land]


def test_who_is_flown_by_hand_is_not_taken_out_of_the_pilots_hands_by_a_permission():
    drone = Drone()
    drone.mode = Mode.OTHER
    assert drone.permit() == ""
    drone.look(50)
    drone.on_ground = True
    drone.look()
    assert drone.kinds() == []
    assert drone.told() == ["the ledger permits the landing at pad-1; the pilot flies"]


def test_a_permission_that_lapses_on_the_way_down_holds_it_again():
    drone = Drone().to_proof()
    drone.permit()
    drone.look(30)
    drone.obey(drone.keeper.revoke("the session ended", drone.seen, drone.now_ms))
    assert drone.kinds()[-1] is GoTo
    drone.look(100)
    assert drone.keeper.phase is Phase.REFUSED
    down = Drone().to_proof()
    down.permit()
    down.on_ground = True
    assert down.keeper.revoke("the session ended", down.seen, down.now_ms) == []


def test_a_mode_that_the_order_before_asked_for_is_no_pilots_will():
    drone = Drone().to_proof()
    drone.obeys = False
    drone.permit()
    drone.obey(drone.keeper.revoke("the session ended", drone.seen, drone.now_ms))
    drone.mode = Mode.LANDING
    drone.look(10)
    assert drone.keeper.phase is Phase.REFUSED, "it shows only now that it had begun to land"
    drone.look(100)
    assert drone.keeper.phase is Phase.OVERRIDDEN, "so long nothing takes to obey"


def test_modes_by_their_numbers():
    px4 = {sub: mode_of(Heartbeat(2, PX4, 0, 4 << 16 | sub << 24)) for sub in range(12)}
    assert {sub: mode for sub, mode in px4.items() if mode is not Mode.OTHER} == {
        3: Mode.HELD,
        4: Mode.MISSION,
        5: Mode.RETURNING,
        6: Mode.LANDING,
        9: Mode.LANDING,
    }
    assert mode_of(Heartbeat(2, PX4, 0, 6 << 16)) is Mode.OTHER, "offboard"
    assert mode_of(Heartbeat(2, ARDUPILOT, 0, 9)) is Mode.LANDING
    assert mode_of(Heartbeat(2, ARDUPILOT, 0, 5)) is Mode.OTHER


def test_a_pad_that_is_forgotten_meanwhile_keeps_the_drone_that_waits_there():
    drone = Drone().to_proof()
    drone.keeper.know([])
    drone.look(10)
    assert drone.permit() != "", "whose place is not known any more permits nothing"
    drone.keeper.know([replace(PAD)])
    assert drone.permit() == ""


def restarted(mode=Mode.HELD, local=(0, 0, 8_000)):
    drone = Drone()
    drone.keeper.know([])
    drone.mode, drone.local = mode, list(local)
    drone.keeper.resume("pad-1")
    drone.look(20)
    assert drone.orders == [], "where the pad is, is not known yet"
    drone.keeper.know([PAD])
    drone.look(2)
    return drone


def test_who_was_held_before_a_restart_is_held_on_and_proves_itself_anew():
    drone = restarted()
    assert drone.kinds() == [GoTo, Prove]
    assert drone.keeper.held_at == "pad-1"


@pytest.mark.parametrize(
    ("mode", "local"), [(Mode.OTHER, (0, 0, 8_000)), (Mode.MISSION, (0, 0, 8_000)), (Mode.HELD, (60_000, 0, 8_000))]
)
def test_who_flies_elsewhere_or_otherwise_after_a_restart_is_left_alone(mode, local):
    drone = restarted(mode, local)
    drone.mode, drone.local = Mode.HELD, [0, 0, 8_000]
    drone.look(20)
    assert drone.kinds() == [], "nor is it taken later"
    assert drone.keeper.held_at is None


def lands(settings=None):
    drone = Drone(settings).to_proof()
    assert drone.permit() == ""
    drone.look(5)
    assert drone.keeper.phase is Phase.LANDING
    return drone


def blown(drone, wrong_mm=(0, 0, 0)):
    """2.5 m to the east; its receiver has it that much farther."""
    drone.local, drone.down = [2_500 + wrong_mm[0], wrong_mm[1], 900 + wrong_mm[2]], 100
    drone.obey(drone.keeper.strayed((2.5, 0.0, 0.9), drone.seen, drone.now_ms))


def test_what_the_wind_takes_aside_goes_around_and_is_held_in_the_end():
    drone = lands(FlightSettings(go_arounds=2))
    for time in (1, 2):
        blown(drone)
        assert (drone.keeper.phase, drone.mode, drone.keeper.landing) == (Phase.TO_PAD, Mode.HELD, True)
        assert drone.told()[-1] == f"2.5 m beside pad-1 by the ranges: going around ({time} of 2)"
        drone.arrive()
        assert (drone.keeper.phase, drone.mode) == (Phase.LANDING, Mode.LANDING)
    blown(drone)
    assert (drone.keeper.phase, drone.mode, drone.keeper.landing) == (Phase.REFUSED, Mode.HELD, False)
    assert "after 2 go-arounds" in drone.keeper.why
    assert Report not in drone.kinds()


def test_a_receiver_that_is_far_off_does_not_lead_a_go_around():
    drone = lands()
    wrong_mm = (9_000, -7_000, 1_500)
    blown(drone, wrong_mm)
    going = to_local(FRAME, drone.going.lat_e7, drone.going.lon_e7, drone.going.height_mm)
    assert math.dist(going, (9_000, -7_000, 8_000 + 1_500)) < 10
    drone.local = [0, 0, 8_000]
    drone.look()
    assert drone.keeper.phase is Phase.TO_PAD, "by its receiver, not by the ranges"
    drone.local = list(going)
    drone.look()
    assert drone.keeper.phase is Phase.LANDING


def test_another_permission_goes_around_as_often_again():
    drone = lands(FlightSettings(go_arounds=1))
    blown(drone)
    drone.arrive()
    assert drone.permit() == ""
    drone.look(5)
    blown(drone)
    assert drone.keeper.phase is Phase.TO_PAD


@pytest.mark.parametrize("who", ["pilot", "down", "stands", "goes there"])
def test_nobody_else_is_taken_from_the_ground_or_from_a_pilot(who):
    drone = lands()
    if who == "pilot":
        drone.mode = Mode.OTHER
    elif who == "down":
        drone.on_ground = True
    elif who == "stands":
        drone.local, drone.down = [400, -300, 100], 0
        drone.look(100)
    else:
        blown(drone)
    before = list(drone.orders)
    blown(drone)
    assert drone.orders == before
