"""The life of sessions and prekeys under any order of transactions, at any time, by anybody."""

from __future__ import annotations

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule, run_state_machine_as_test

from wonderland.proofs import encoding
from wonderland.proofs.records import keys
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.uavs import Uav
from wonderland.proofs.records.verdicts import Verdict
from wonderland_chaincode.contract import ContractError

NEXT = {
    "requested": {"decided", "cancelled"},
    "decided": {"completed", "cancelled"},
    "completed": set(),
    "cancelled": set(),
}
PREKEYS = ("k1", "k2", "k3", "k4")
# Hypothesis shrinks and leans towards what stands first: what leads on, so that runs get far before they stray.
recent = st.sampled_from([0, 0, 0, 0, 1, 1, 2, 3])


def mostly(first, *others):
    return st.sampled_from([first] * (3 * len(others)) + list(others))


class Sessions(RuleBasedStateMachine):
    def __init__(self, scene) -> None:
        super().__init__()
        self.scene = scene
        self.states: dict[str, str] = {}
        self.prekey_of: dict[str, str] = {}
        self.verdicts: dict[str, bytes] = {}

    def attempt(self, who, function, argument=None, **fields):
        try:
            return self.scene.call(who, function, argument, **fields)
        except ContractError:
            return None

    def session(self, index):
        known = list(self.states)
        return self.load(known[-1 - index % len(known)])

    def load(self, session_id):
        return encoding.decode(self.scene.state[keys.composite(keys.SESSION, session_id)])

    @rule(prekey=st.sampled_from(PREKEYS), number=st.integers(2000, 2100))
    def publish(self, prekey, number):
        self.attempt(
            self.scene.pad,
            "PublishPrekeys",
            pad_id="pad-1",
            prekeys=[{"prekey_id": prekey, "public_key": self.scene.point(number)}],
        )

    @rule(prekey=st.sampled_from(PREKEYS), by=mostly("uav", "other_uav", "pad"))
    def request(self, prekey, by):
        session = self.attempt(getattr(self.scene, by), "RequestProof", self.scene.request_argument(prekey))
        if session is not None:
            assert prekey not in self.prekey_of, "a prekey opened two sessions"
            self.prekey_of[prekey] = session["session_id"]
            self.states[session["session_id"]] = "requested"

    @precondition(lambda self: self.states)
    @rule(
        index=recent,
        by=mostly("pad", "other_pad", "uav"),
        truth=mostly((2_000, 1_000, 1_500), (2_400, 1_000, 1_500), (8_000, 1_000, 1_500)),
        rounds=mostly(40, 12, 3),
        matched=mostly("both", "none"),
        signed=mostly("uav", "other_uav"),
    )
    def submit(self, index, by, truth, rounds, matched, signed):
        session = self.session(index)
        signer = getattr(self.scene, signed)
        evidence = self.scene.evidence(session, truth, rounds=rounds, matched=matched, signer=signer)
        verdict = self.attempt(
            getattr(self.scene, by), "SubmitProof", session_id=session["session_id"], evidence=evidence
        )
        if verdict is not None:
            assert by == "pad"
            assert self.scene.now_ms < session["expires_ms"]
            if verdict["permission"] == "granted":
                assert matched == "both"
                assert signed == "uav"
                assert session["uav_id"] == "1AB0000001"
                assert truth != (8_000, 1_000, 1_500)
                uav = Uav.decode(self.scene.state[keys.composite(keys.UAV, session["uav_id"])])
                assert uav.status == "active"

    @precondition(lambda self: self.states)
    @rule(index=recent, by=mostly("uav", "pad", "other_uav"), result=st.sampled_from(["done", "aborted"]))
    def complete(self, index, by, result):
        session = self.session(index)
        self.attempt(getattr(self.scene, by), "CompleteInteraction", session_id=session["session_id"], result=result)

    @precondition(lambda self: len(self.states) > 1)
    @rule(index=recent, by=st.sampled_from(["pad", "uav", "admin", "other_pad"]))
    def cancel(self, index, by):
        session = self.session(index)
        ended = self.attempt(getattr(self.scene, by), "CancelProof", session_id=session["session_id"], reason="timeout")
        if ended is not None and session["state"] == "decided":
            verdict = encoding.decode(self.verdicts[session["session_id"]])
            assert verdict["permission"] == "refused" or self.scene.now_ms >= session["expires_ms"]

    @rule(milliseconds=mostly(1, 3_000, 61_000))
    def wait(self, milliseconds):
        self.scene.now_ms += milliseconds

    @precondition(lambda self: "requested" in self.states.values())
    @rule(index=recent)
    def prove(self, index):
        """What honest parties do; without it most walks would stray before anything is decided."""
        waiting = [session_id for session_id, state in self.states.items() if state == "requested"]
        session = self.load(waiting[-1 - index % len(waiting)])
        evidence = self.scene.evidence(session)
        self.attempt(self.scene.pad, "SubmitProof", session_id=session["session_id"], evidence=evidence)

    @rule(status=mostly("active", "suspended"), range_sigma_mm=mostly(25, 26))
    def authority(self, status, range_sigma_mm):
        if status == "active":
            lifted = self.attempt(self.scene.admin, "ProposeReinstatement", uav_id="1AB0000001", reason="x")
            if lifted is not None:
                self.attempt(self.scene.inspector, "ApproveChange", **self.scene.approval(lifted))
        else:
            self.attempt(self.scene.admin, "SetUavStatus", uav_id="1AB0000001", status=status, reason="x")
        commissioning = self.scene.commissioning(range_sigma_mm=range_sigma_mm)
        self.attempt(self.scene.operator, "CommissionPad", pad_id="pad-1", commissioning=commissioning)

    @invariant()
    def states_only_move_forward(self):
        for session_id, before in self.states.items():
            now = self.load(session_id)["state"]
            assert now == before or now in NEXT[before], f"{before} → {now}"
            self.states[session_id] = now

    @invariant()
    def every_stored_record_can_be_read(self):
        for key, data in self.scene.state.items():
            kind, _ = keys.split(key)
            if kind == keys.SESSION:
                Session.decode(data)
            elif kind == keys.VERDICT:
                Verdict.decode(data)

    @invariant()
    def a_verdict_stands_for_ever_and_permits_only_what_is_verified_and_authorised(self):
        for session_id, state in self.states.items():
            data = self.scene.state.get(keys.composite(keys.VERDICT, session_id))
            if data is None:
                assert state in {"requested", "cancelled"}
                continue
            assert self.verdicts.setdefault(session_id, data) == data
            verdict = encoding.decode(data)
            permitted = verdict["permission"] == "granted"
            assert permitted == (verdict["outcome"] == "verified" and verdict["authorised"])
            assert permitted or state != "completed"

    @invariant()
    def a_prekey_is_waiting_or_used_but_never_both(self):
        for prekey in PREKEYS:
            waiting = keys.composite(keys.PREKEY, "pad-1", prekey) in self.scene.state
            used = self.scene.state.get(keys.composite(keys.USED_PREKEY, "pad-1", prekey))
            assert not (waiting and used is not None)
            if prekey in self.prekey_of:
                assert used == encoding.encode({"session_id": self.prekey_of[prekey]})


def test_sessions_and_prekeys_under_any_order_of_transactions(make_scene):
    def start():
        scene = make_scene().ready()
        scene.call(scene.fleet, "RegisterUav", scene.uav_argument("1AB0000002"))
        return Sessions(scene)

    run_state_machine_as_test(
        start,
        settings=settings(
            deadline=None,
            derandomize=True,
            max_examples=150,
            stateful_step_count=40,
            suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
        ),
    )
