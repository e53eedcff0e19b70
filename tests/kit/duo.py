"""A pad's and a drone's machine in virtual time, without any I/O."""

from __future__ import annotations

import hashlib
import random
from dataclasses import replace

from cryptography.hazmat.primitives.asymmetric import ec

from kit.agents import ANCHORS, Flight, commissioning
from wonderland.proofs import encoding, keys
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import Evidence, Party, Session
from wonderland.proofs.statement import statement
from wonderland.proofs.transcript import transcript_of
from wonderland.proofs.verdict import decide
from wonderland_edge_agent.session import actions as pad_do
from wonderland_edge_agent.session import events as pad_on
from wonderland_edge_agent.session.machine import PadSession
from wonderland_fabric_gateway.errors import SignatureError
from wonderland_fabric_gateway.signing import der_from_raw, key_signer, raw_from_der, verify
from wonderland_uav_agent.session import actions as uav_do
from wonderland_uav_agent.session import events as uav_on
from wonderland_uav_agent.session.machine import UavSession


def private_key(number: int) -> ec.EllipticCurvePrivateKey:
    return ec.derive_private_key(number, ec.SECP256R1())


class Duo:
    """A pad's and a drone's machine, a perfect radio between them, and a clock that jumps from event to event.

    Each side can be silenced (``dead``) from any step on. ``pad_actions`` and ``uav_actions`` log what each wanted.
    """

    START_MS = 1_800_000_000_000

    def __init__(self, *, flight: Flight | None = None, policy: Policy | None = None, **more) -> None:
        self.now_ms = self.START_MS
        self.flight = flight or Flight()
        self.rng = random.Random(3)
        self.commissioning = replace(
            commissioning(self.now_ms, timed=more.get("timed", False)), nodes=more.get("nodes")
        )
        self.blink_payload = b""
        self.blinks = 0
        self.uav_key = private_key(77)
        pad_secret, uav_secret = private_key(5), private_key(6)
        blank = Session(
            session_id=more.get("session_id", "a" * 64),
            state="requested",
            pad_id="pad-1",
            uav_id="uav-1",
            action="land",
            claim=self.flight.claim(self.now_ms),
            prekey_id="k1",
            pad_key=encoding.to_base64url(keys.public_bytes(pad_secret)),
            uav_key=encoding.to_base64url(keys.public_bytes(uav_secret)),
            pad=Party(msp_id="PadMSP", certificate_sha256=hashlib.sha256(b"pad certificate").hexdigest()),
            uav=Party(
                msp_id="FleetMSP",
                certificate_sha256=hashlib.sha256(b"uav certificate").hexdigest(),
                public_key=encoding.to_base64url(keys.public_bytes(self.uav_key)),
            ),
            commissioning_sha256=encoding.digest(self.commissioning.to_json()).hex(),
            contract_version="1",
            transcript_sha256="",
            policy=policy or Policy(),
            requested_ms=self.now_ms,
            expires_ms=self.now_ms + (policy or Policy()).session_ttl_ms,
        )
        digest = transcript_of(blank, "wonderland").digest()
        self.session = replace(blank, transcript_sha256=digest.hex())
        secret = keys.shared_secret(pad_secret, encoding.from_base64url(blank.uav_key))
        derived = keys.derive(secret, digest)
        self.pad = PadSession(
            self.session,
            self.commissioning,
            more.get("pad_keys") or derived,
            certificate=more.get("pad_certificate", b"pad certificate"),
            broadcasts=more.get("heard", lambda since_ms: ()),
            random_octets=lambda count: bytes(range(1, count + 1)),
            now_ms=self.now_ms,
            drift_sigma_mm=more.get("drift_sigma_mm"),
            whole_certificate=more.get("whole_certificate", False),
        )
        self.uav = UavSession(
            self.session,
            self.commissioning,
            more.get("uav_keys") or derived,
            certificate=more.get("uav_certificate", b"uav certificate"),
            claims=self.flight.claim,
            now_ms=self.now_ms,
            whole_certificate=more.get("whole_certificate", False),
            **({"broadcasts": more["sent"]} if "sent" in more else {}),
        )
        self.keys = derived
        self.pad_actions: list = []
        self.uav_actions: list = []
        self.dead: set[str] = set()
        self.mute: set[str] = set()
        """Who is not heard, although alive."""
        self.ledger_state = "requested"
        self.ledger_end = ""
        self.evidence = None
        self.verdict = None
        self.ledger_away = False
        self.when: list = []
        """(condition, consequence): each is tried after every event until it fires."""
        self._round_ms = self.now_ms
        self._ranging = {"pad": False, "uav": False}
        self._a_frames: list[bytes] = []
        self._b_frames: list[bytes] = []

    def on(self, condition, consequence) -> None:
        self.when.append((condition, consequence))

    def tell_pad(self, event) -> None:
        if "pad" not in self.dead:
            self._pad(self.pad.handle(event, self.now_ms))

    def tell_uav(self, event) -> None:
        if "uav" not in self.dead:
            self._uav(self.uav.handle(event, self.now_ms))

    def run(self, limit_ms: int = 200_000) -> None:
        """Until both have ended or are dead."""
        self._pad(self.pad.start(self.now_ms))
        self._uav(self.uav.start(self.now_ms))
        end_ms = self.now_ms + limit_ms
        while self.now_ms < end_ms and not (self._over("pad", self.pad) and self._over("uav", self.uav)):
            self.now_ms += 5
            self._radio()
            if "pad" not in self.dead:
                self._a_or_b()
            self.tell_pad(pad_on.Tick()) if self._due(self.pad) else None
            self.tell_uav(uav_on.Tick()) if self._due(self.uav) else None
            for entry in list(self.when):
                if entry[0](self):
                    self.when.remove(entry)
                    entry[1](self)

    def _over(self, who, machine) -> bool:
        return who in self.dead or machine.phase.value == "ended"

    def _due(self, machine) -> bool:
        tick_ms = machine.next_tick_ms()
        return tick_ms is not None and self.now_ms >= tick_ms

    def _a_or_b(self) -> None:
        frames_ms = self.pad.next_frames_ms()
        if frames_ms is not None and self.now_ms >= frames_ms:
            if not self._b_frames:
                self._b_frames = self.pad.frames_to_send(self.now_ms)
            self.tell_pad(pad_on.Tick())

    def _radio(self) -> None:
        if "uav" not in self.dead:
            frames_ms = self.uav.next_frames_ms()
            if frames_ms is not None and self.now_ms >= frames_ms:
                self._a_frames = self._a_frames or self.uav.frames_to_send(self.now_ms)
        both = all(self._ranging.values()) and not self.dead
        if self.now_ms >= self._round_ms + self.pad.plan.interval_ms:
            self._round_ms += self.pad.plan.interval_ms
            back, self._b_frames = self._b_frames, []
            if both and "pad" not in self.mute:
                for frame in back:
                    self.tell_uav(uav_on.DataHeard(frame))
            frames, self._a_frames = self._a_frames, []
            if not both or "uav" in self.mute:
                return
            self.blinks += 1
            for name, place in ANCHORS.items():
                if name in self.flight.silent:
                    continue
                range_mm = round(self.flight.range_mm(name, self.rng) / 10) * 10
                self.tell_pad(pad_on.AnchorRange(name, self.now_ms, range_mm))
                if self.pad.plan.blinks is not None:
                    # The counter's end lies within the session.
                    ticks = self.flight.stamp(place, 17.0 + (self.now_ms - self.START_MS) / 1000, self.rng)
                    self.tell_pad(pad_on.FrameHeard(name, self.now_ms, self.blinks, ticks, self.blink_payload))
                self.tell_uav(uav_on.OwnRange(0xA000 + list(ANCHORS).index(name), self.now_ms, range_mm))
            for frame in frames:
                self.tell_pad(pad_on.DataHeard(frame))

    def _pad(self, actions) -> None:
        for action in actions:
            self.pad_actions.append(action)
            match action:
                case pad_do.OpenRadios() if "pad radios" not in self.dead:
                    self._ranging["pad"] = True
                    self.tell_pad(pad_on.RadiosOpened("UCI 2"))
                case pad_do.CloseRadios():
                    self._ranging["pad"] = False
                case pad_do.Submit():
                    self.evidence = action.evidence
                    if not self.ledger_away and self.ledger_state == "requested":
                        self._decide(action.evidence)
                case pad_do.Permit():
                    self.when.insert(0, (lambda duo: True, lambda duo: duo.tell_pad(pad_on.Permitted())))
                case pad_do.Cancel():
                    self._cancel("pad", action.reason)

    def _uav(self, actions) -> None:
        for action in actions:
            self.uav_actions.append(action)
            match action:
                case uav_do.OpenRadios() if "uav radios" not in self.dead:
                    self._ranging["uav"] = True
                    self.tell_uav(uav_on.RadiosOpened())
                case uav_do.CloseRadios():
                    self._ranging["uav"] = False
                case uav_do.AnswerInBlinks():
                    self.blink_payload = action.answer
                case uav_do.Sign():
                    self.tell_uav(uav_on.Signed(raw_from_der(key_signer(self.uav_key)(action.statement))))
                case uav_do.Act():
                    self.when.append((lambda duo: True, lambda duo: duo.tell_uav(uav_on.Acted("done"))))
                case uav_do.Complete():
                    self.ledger_state, self.ledger_end = "completed", action.result
                    self.tell_pad(pad_on.InteractionCompleted(action.result))
                case uav_do.Cancel():
                    self._cancel("uav", action.reason)

    def _cancel(self, who, reason) -> None:
        granted = self.verdict is not None and self.verdict.permission == "granted"
        if self.ledger_state == "requested" or (self.ledger_state == "decided" and not granted):
            self.ledger_state, self.ledger_end = "cancelled", reason
            event = (who, reason)
            self.tell_uav(uav_on.SessionCancelled(*event)) if who == "pad" else self.tell_pad(
                pad_on.SessionCancelled(*event)
            )
        elif granted and self.now_ms >= self.session.expires_ms:
            self.ledger_state, self.ledger_end = "cancelled", reason

    def _decide(self, evidence: Evidence) -> None:
        message = statement(
            self.session.session_id,
            self.session.transcript_sha256,
            evidence.ranges,
            evidence.claims,
            evidence.attested,
        )
        valid = None
        if evidence.uav_signature is not None:
            try:
                verify(
                    self.uav_key.public_key(),
                    message,
                    der_from_raw(encoding.from_base64url(evidence.uav_signature)),
                )
                valid = True
            except SignatureError:
                valid = False
        self.verdict = decide(
            self.session,
            self.commissioning,
            Evidence.parse(evidence.to_json()),
            confirmed=evidence.matched == "both",
            signature_valid=valid,
            authorisation=(),
            now_ms=self.now_ms,
            evidence_sha256=encoding.digest(evidence.to_json()).hex(),
        )
        self.ledger_state = "decided"
        self.tell_uav(uav_on.VerdictCommitted(self.verdict, "b" * 64))
        self.tell_pad(pad_on.VerdictCommitted(self.verdict, "b" * 64))

    # what a test asks

    def of(self, actions, kind) -> list:
        return [action for action in actions if isinstance(action, kind)]

    @property
    def pad_end(self):
        return self.of(self.pad_actions, pad_do.Finish)[0] if self.of(self.pad_actions, pad_do.Finish) else None

    @property
    def uav_end(self):
        return self.of(self.uav_actions, uav_do.Finish)[0] if self.of(self.uav_actions, uav_do.Finish) else None

    def failures(self) -> list[str]:
        return [action.detail for action in self.pad_actions if isinstance(action, pad_do.ReportStep) and not action.ok]
