"""A pad's and a drone's machine over virtual boards on one air, in virtual time."""

from __future__ import annotations

from kit.agents import ANCHORS
from kit.duo import Duo
from kit.virtual_air import Host, VirtualAir
from wonderland.uwb.agreed import ability_of
from wonderland_edge_agent.session import actions as pad_do
from wonderland_edge_agent.session import events as pad_on
from wonderland_fira_uci.uci.capabilities import decode_capabilities
from wonderland_fira_uci.uci.config import encode_parameters
from wonderland_simulator.uci_node import Measurement, NodeProfile
from wonderland_uav_agent.session import actions as uav_do
from wonderland_uav_agent.session import events as uav_on


def ability(profile: NodeProfile):
    """As the agents have it: by what the node says, and by what its operator knows."""
    said = decode_capabilities(encode_parameters(list(profile.capabilities)), profile.info.uci_version)
    words = "both_ways" if profile.quirks.responder_data else "initiator"
    return ability_of(said, words)


class AirDuo(Duo):
    """``air``: where other boards may be, too; this pair's boards are A1 to A4 and uav, and stay for the next pair."""

    def __init__(self, profile: NodeProfile, air: VirtualAir, *, noise_seed: int = 3, **more) -> None:
        super().__init__(nodes=ability(profile), **more)
        self.rng.seed(noise_seed)
        self.virtual = air
        self.start_air_ms = air.now_ms
        self.wanted: set[str] = set()
        self.drawn: dict[tuple[str, float], Measurement] = {}
        for name in (*ANCHORS, "uav"):
            if name not in air.hosts:
                air.add(name, profile)
            self.host(name).messages.clear()
        self.told = dict.fromkeys((*ANCHORS, "uav"), 0)
        air.air.measure = self.measure
        air.air.stamp = self.stamp

    def host(self, name: str) -> Host:
        return self.virtual.hosts[name]

    def measure(self, observer: str, peer: str, t_s: float) -> Measurement:
        anchor = observer if observer in ANCHORS else peer
        if anchor not in ANCHORS:
            return Measurement(self.virtual.range_mm(observer, peer))
        if (anchor, t_s) not in self.drawn:
            self.drawn[anchor, t_s] = Measurement(round(self.flight.range_mm(anchor, self.rng)), nlos=False)
        return self.drawn[anchor, t_s]

    def stamp(self, anchor: str, tag: str, t_s: float) -> int:
        return self.flight.stamp(ANCHORS[anchor], t_s, self.rng)

    def _radio(self) -> None:
        plan = self.pad.plan
        for side, out, machine, session_id in (
            ("uav", "uav", self.uav, plan.session_a_id),
            (
                "pad",
                next(iter(ANCHORS)),
                self.pad,
                plan.session_a_id if plan.pad_words() is None else plan.session_b_id,
            ),
        ):
            frames_ms = machine.next_frames_ms()
            ready = self._ranging[side] and self.host(out).device.has_credit(session_id)
            if ready and frames_ms is not None and self.now_ms >= frames_ms:
                frames = machine.frames_to_send(self.now_ms)
                if frames:
                    self.virtual.send(out, session_id, b"".join(frames))
        behind = self.now_ms - self.START_MS - (self.virtual.now_ms - self.start_air_ms)
        self.virtual.run(max(behind, 0))
        self._opened()
        for index, name in enumerate(ANCHORS):
            for message in self._fresh(name):
                self._from_anchor(index, name, message)
        for message in self._fresh("uav"):
            self._from_uav(message)

    def _a_or_b(self) -> None:
        """The pad's frames go with the rest, in ``_radio``."""

    def _fresh(self, name: str):
        messages = self.host(name).messages
        out, self.told[name] = messages[self.told[name] :], len(messages)
        return out

    def _opened(self) -> None:
        plan = self.pad.plan
        if "pad" in self.wanted and all(self.host(name).active(plan.session_a_id) for name in ANCHORS):
            self.wanted.discard("pad")
            self._ranging["pad"] = True
            self.tell_pad(pad_on.RadiosOpened("UCI 2"))
        if "uav" in self.wanted and self.host("uav").active(plan.session_a_id):
            self.wanted.discard("uav")
            self._ranging["uav"] = True
            self.tell_uav(uav_on.RadiosOpened())

    def _from_anchor(self, index: int, name: str, message) -> None:
        body = message.message
        if hasattr(body, "two_way"):
            for record in body.two_way if message.session_id == self.pad.plan.session_a_id else ():
                self.tell_pad(pad_on.AnchorRange(name, self.now_ms, record.range_mm, bool(record.obstructed)))
            for record in body.one_way:
                self.tell_pad(
                    pad_on.FrameHeard(
                        name, self.now_ms, record.frame_number, record.timestamp_ticks, record.blink_payload
                    )
                )
        elif hasattr(body, "data") and body.data and index == 0:
            self.tell_pad(pad_on.DataHeard(body.data))

    def _from_uav(self, message) -> None:
        body = message.message
        if hasattr(body, "two_way"):
            for record in body.two_way:
                if record.range_mm is not None and message.session_id == self.pad.plan.session_a_id:
                    self.tell_uav(uav_on.OwnRange(record.mac_address, self.now_ms, record.range_mm))
        elif hasattr(body, "data") and body.data:
            self.tell_uav(uav_on.DataHeard(body.data))

    def _pad(self, actions) -> None:
        super()._pad([each for each in actions if not isinstance(each, pad_do.OpenRadios | pad_do.CloseRadios)])
        for action in actions:
            if isinstance(action, pad_do.OpenRadios):
                self.pad_actions.append(action)
                blinks = self.pad.plan.timed_blinks()
                for index, name in enumerate(ANCHORS):
                    words = self.pad.plan.pad_words() if index == 0 else None
                    stamps = None if blinks is None else blinks.pad_anchor(index)
                    self.virtual.open(name, self.pad.plan.pad_ranging(index), words, stamps)
                self.wanted.add("pad")
            elif isinstance(action, pad_do.CloseRadios):
                self.pad_actions.append(action)
                self._ranging["pad"] = False
                self._close(ANCHORS)

    def _uav(self, actions) -> None:
        ours = uav_do.OpenRadios | uav_do.CloseRadios | uav_do.AnswerInBlinks
        super()._uav([each for each in actions if not isinstance(each, ours)])
        for action in actions:
            plan = self.uav.plan
            blinks = plan.timed_blinks()
            if isinstance(action, uav_do.OpenRadios):
                tag = None if blinks is None else blinks.uav_tag()
                self.virtual.open("uav", plan.uav_ranging(), plan.uav_words(), tag)
                self.wanted.add("uav")
            elif isinstance(action, uav_do.CloseRadios):
                self._ranging["uav"] = False
                self._close(("uav",))
            elif isinstance(action, uav_do.AnswerInBlinks) and blinks is not None:
                self.virtual.send("uav", blinks.session_id, action.answer)
            else:
                continue
            self.uav_actions.append(action)

    def _close(self, names) -> None:
        for name in names:
            self.virtual.close_sessions(name)
