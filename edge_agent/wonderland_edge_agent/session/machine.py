"""The pad's side of one proof as an explicit state machine: events in, actions out, no I/O.

Phases and the steps of the paper that they hold:

* OPENING: the nodes are being told the sessions. The request is VALID already: that is why this machine exists.
* POLLING (2, 3, 4): the pad has said its code over UWB and waits for the drone's.
* RANGING (5): rounds, claims, identity and the echo of a challenge come in; the pad looks at 10, 20, 40, 80 and 160
  rounds whether the contract would be settled.
* CONFIRMING (6): the drone has been told all ranges and has to countersign them with its claims.
* SUBMITTING (7): the evidence is before the contract.
* PERMITTED (8): a committed verdict granted it; the drone acts and completes, or the permission lapses.
* ENDED.

Whatever fails after the poll is brought before the contract with its reason, so that it is judged and on the record;
what fails before it is cancelled with its reason.
"""

from __future__ import annotations

import hmac
from collections.abc import Callable
from enum import Enum
from typing import Final

from wonderland.proofs.broadcast import NEAR_CLAIM_MS
from wonderland.proofs.encoding import to_base64url
from wonderland.proofs.keys import SessionKeys
from wonderland.proofs.prospects import hopeless
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.sessions import Evidence, Radio, Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.rounds import MIN_ANCHORS
from wonderland.proofs.stopping import LOOKS
from wonderland.proofs.verdict import preview
from wonderland.session.pace import pace_of
from wonderland.session.words import Word
from wonderland.telemetry import StepName
from wonderland.uwb.agreed import agreed_plan
from wonderland.uwb.layout import RangingPlan
from wonderland.uwb.link.messages import AbortReason
from wonderland_edge_agent.session import actions as do
from wonderland_edge_agent.session import events as on
from wonderland_edge_agent.session.broadcasts import Broadcasts, HeardBroadcasts
from wonderland_edge_agent.session.evidence import GatheredEvidence
from wonderland_edge_agent.session.frames import FrameGatherer
from wonderland_edge_agent.session.ranging import Ranging
from wonderland_edge_agent.session.timing import PadTiming
from wonderland_edge_agent.session.words import PadWords

Judge = Callable[[Session, Commissioning, Evidence, int], Verdict]


class Phase(Enum):
    """Where a session stands on the pad."""

    OPENING = "opening"
    POLLING = "polling"
    RANGING = "ranging"
    CONFIRMING = "confirming"
    SUBMITTING = "submitting"
    PERMITTED = "permitted"
    ENDED = "ended"


GUIDED: Final = frozenset({"land", "dock"})
"""Actions in which the nodes range on until the drone is down, for as long as it ranges."""
_SPEAKING: Final = frozenset({Phase.POLLING, Phase.RANGING, Phase.CONFIRMING, Phase.SUBMITTING})


class PadSession:
    """One proof at one pad.

    ``session`` and ``commissioning`` come from the ledger, ``keys`` from their transcript. ``random_octets`` must be
    unpredictable: the challenge and its moment come from it. ``certificate`` is the pad's own (DER); it is said whole
    instead of by its hash where ``whole_certificate`` is set. ``measured_by`` and ``sts`` are the nodes' way of
    ranging, for the evidence. All times are milliseconds on one steady clock.
    """

    def __init__(
        self,
        session: Session,
        commissioning: Commissioning,
        keys: SessionKeys,
        *,
        certificate: bytes,
        broadcasts: Broadcasts,
        random_octets: Callable[[int], bytes],
        now_ms: int,
        timing: PadTiming | None = None,
        whole_certificate: bool = False,
        measured_by: str = "pad",
        sts: str = "provisioned",
        drift_sigma_mm: int | None = None,
        judge: Judge = preview,
        unsure: Broadcasts = lambda _since_ms: (),
        interval_ms: int | None = None,
    ) -> None:
        self.session: Final = session
        self.commissioning: Final = commissioning
        self.phase = Phase.OPENING
        self.verdict: Verdict | None = None
        self._timing = timing or PadTiming()
        anchor_ids = [anchor.anchor_id for anchor in commissioning.anchors]
        self._plan = agreed_plan(keys, commissioning, session.node)
        pace = 1.0 if interval_ms else pace_of(self._plan)
        self._timing = self._timing.paced(pace)
        self._gathered = GatheredEvidence(anchor_ids)
        self._broadcasts = HeardBroadcasts(
            session, commissioning.frame, broadcasts, unsure, lambda: (self._gathered.claims, self._gathered.clock)
        )
        self._frames = FrameGatherer(anchor_ids, "challenge")
        self._hopeless = hopeless(commissioning, session.policy, session.claim)
        self._ranging = Ranging(
            self._gathered,
            lambda at_ms: judge(session, commissioning, self._evidence(at_ms), at_ms),
            interval_ms=interval_ms or self._plan.interval_ms,
            measured_ago_ms=0 if interval_ms else self._plan.measured_ago_ms,
            max_rounds=min(session.policy.max_rounds, LOOKS[0]) if self._hopeless else session.policy.max_rounds,
            timing=self._timing,
            stamps_frames=self._plan.blinks is not None and measured_by == "pad",
        )
        self._words = PadWords(
            session,
            keys,
            certificate=certificate,
            whole_certificate=whole_certificate,
            now_ms=now_ms,
            word_octets=self._plan.word_octets,
            pace=pace,
        )
        self._code_uav = keys.code_uav
        self._challenge = random_octets(8)
        self._answer = keys.answer(self._challenge)
        self._asked_ms = 0
        self._awaits_witness = session.witness is not None
        spread = max(1, self._timing.challenge_spread_ms)
        self._challenge_delay_ms = int.from_bytes(random_octets(4), "big") % spread
        self._measured_by = measured_by
        self._sts = sts
        self._drift_sigma_mm = drift_sigma_mm
        self._firmware: str | None = None
        self._matched = False
        self._signature: str | None = None
        self._failure: str | None = None
        self._times: dict[str, int] = {}
        """Deadlines and moments by name; each is taken out when it is met."""
        self._times["open"] = now_ms + self._timing.open_ms
        self._cutoff_ms = session.expires_ms - min(
            self._timing.submit_reserve_ms, max(0, (session.expires_ms - now_ms) // 3)
        )

    @property
    def evidence(self) -> GatheredEvidence:
        """What was gathered so far."""
        return self._gathered

    @property
    def plan(self) -> RangingPlan:
        """What the nodes are told."""
        return self._plan

    def start(self, now_ms: int) -> list[do.PadAction]:
        """First actions: the request is on the ledger, the nodes are opened."""
        actions: list[do.PadAction] = []
        detail = f"cannot settle: {self._hopeless}" if self._hopeless else ""
        self._reach("request", min(now_ms, self.session.requested_ms), actions, detail=detail)
        if self._hopeless and self.session.policy.cancel_hopeless:
            self._cancel("cannot_settle", self._hopeless, now_ms, actions)
        else:
            actions.append(do.OpenRadios(self._plan))
        return actions

    def handle(self, event: on.PadEvent, now_ms: int) -> list[do.PadAction]:
        """Take one event at this time; returns what is to be done, in order."""
        actions: list[do.PadAction] = []
        if self.phase is Phase.ENDED:
            return actions
        match event:
            case on.AnchorRange() if self.phase is Phase.PERMITTED:
                self._guided(event, now_ms)
            case on.AnchorRange():
                self._ranging.take(event.anchor_id, event.t_ms, event.range_mm, nlos=event.nlos, now_ms=now_ms)
            case on.FrameHeard():
                self._frames.add(event.anchor_id, event.t_ms, event.number, event.ticks, event.payload)
            case on.DataHeard():
                self._words.receive(event.data, now_ms)
            case on.RadiosOpened():
                self._radios_opened(event, now_ms)
            case on.RadiosFailed():
                self._radios_failed(event, now_ms, actions)
            case on.VerdictCommitted():
                self._decided(event, now_ms, actions)
            case on.Witnessed():
                self._awaits_witness = False
                if self._times.pop("witness", None) is not None:
                    self._submit(now_ms, actions)
            case on.Permitted() if self.phase is Phase.PERMITTED:
                self._reach("permission", now_ms, actions, detail="granted")
            case on.SubmitRefused():
                self._refused(event, now_ms, actions)
            case on.LedgerLost():
                self._end("requested", "ledger_lost", now_ms, actions, detail=event.detail)
            case on.SessionCancelled():
                self._cancelled(event, now_ms, actions)
            case on.InteractionCompleted():
                self._completed(event, now_ms, actions)
            case on.Interrupted():
                self._interrupted(event, now_ms, actions)
            case _:
                pass
        self._words_heard(now_ms, actions)
        if self.phase in {Phase.RANGING, Phase.CONFIRMING}:
            self._broadcasts.listen(self._since_ms(now_ms), now_ms)
        self._time_passed(now_ms, actions)
        return actions

    def frames_to_send(self, now_ms: int) -> list[bytes]:
        """Frames for one data unit of the node that speaks; call it when ``next_frames_ms`` has come."""
        return self._words.frames_to_send(now_ms) if self.phase in _SPEAKING else []

    def next_frames_ms(self) -> int | None:
        """When ``frames_to_send`` will have something; None while all is quiet."""
        return self._words.next_wakeup_ms() if self.phase in _SPEAKING else None

    def next_tick_ms(self) -> int | None:
        """When the machine wants a Tick if nothing else happens; None once it has ended."""
        if self.phase is Phase.ENDED:
            return None
        times = list(self._times.values())
        if self.phase is Phase.RANGING:
            times.append(self._ranging.next_ms())
        if self.phase in {Phase.POLLING, Phase.RANGING, Phase.CONFIRMING}:
            times.append(self._cutoff_ms)
        return min(times, default=self.session.expires_ms)

    # --- the steps ---------------------------------------------------------------------------------------------

    def _radios_opened(self, event: on.RadiosOpened, now_ms: int) -> None:
        """Step 2: poll."""
        if self.phase is not Phase.OPENING:
            return
        self._times.pop("open", None)
        self._firmware = event.firmware
        self.phase = Phase.POLLING
        self._words.poll(now_ms)
        self._times["reply"] = now_ms + self._timing.reply_ms

    def _radios_failed(self, event: on.RadiosFailed, now_ms: int, actions: list[do.PadAction]) -> None:
        if self.phase is Phase.OPENING:
            self._cancel("radios_unavailable", event.detail, now_ms, actions)
        elif self.phase in {Phase.POLLING, Phase.RANGING, Phase.CONFIRMING}:
            self._fail("radios_lost", event.detail, now_ms, actions)

    def _words_heard(self, now_ms: int, actions: list[do.PadAction]) -> None:
        """Steps 3 to 6 as far as the drone's words carry them."""
        for heard in self._words.heard():
            if self.phase not in {Phase.POLLING, Phase.RANGING, Phase.CONFIRMING}:
                return
            match heard.word:
                case Word.POLL_SENT:
                    self._reach("poll", heard.t_ms, actions)
                case Word.POLL_DELIVERED:
                    pass  # it arrived; whether the drone matched it, the reply says
                case Word.REPLY:
                    self._replied(heard.octets, heard.t_ms, now_ms, actions)
                case Word.CLAIMS:
                    if heard.claims is None or not self._gathered.add_claims(heard.claims):
                        self._fail("claims_out_of_order", "claims do not follow on one another", now_ms, actions)
                    else:
                        for claim in heard.claims.claims:
                            self._gathered.read_clock(claim.t_ms, now_ms)
                    self._ranging.heard_claim(now_ms)
                case Word.IDENTITY:
                    self._times.pop("identity", None)
                case Word.ECHO:
                    self._echoed(heard.octets, heard.t_ms, now_ms, actions)
                case Word.ATTESTED:
                    if not self._gathered.attest(heard.digests):
                        self._fail("out_of_turn", "a second list of broadcasts", now_ms, actions)
                case Word.SIGNATURE:
                    self._signed(heard.octets, now_ms, actions)
                case Word.ABORT:
                    self._fail(_ABORTS.get(heard.abort, "drone_aborted"), heard.detail, now_ms, actions)
                case Word.BROKEN:
                    self._fail(heard.reason, heard.detail, now_ms, actions)

    def _replied(self, code: bytes, matched_ms: int, now_ms: int, actions: list[do.PadAction]) -> None:
        """Step 4: the drone's code. Its own word on when it matched the pad's counts within what the pad saw."""
        if self.phase is not Phase.POLLING:
            self._fail("out_of_turn", "a second reply", now_ms, actions)
            return
        if not hmac.compare_digest(code, self._code_uav):
            self._words.abort(AbortReason.CODE_MISMATCH, now_ms)
            self._fail("code_mismatch", "the drone's session code is not the one of this session", now_ms, actions)
            return
        self._times.pop("reply", None)
        self._matched = True
        self._reach("poll", now_ms, actions)
        polled_ms = self._gathered.steps["poll"]
        self._gathered.read_clock(matched_ms, now_ms, polled_ms)
        self._reach("match", min(max(matched_ms, polled_ms), now_ms), actions)
        self._reach("reply", now_ms, actions)
        self.phase = Phase.RANGING
        self._ranging.start(now_ms)
        self._words.introduce(now_ms)
        self._times["identity"] = now_ms + self._timing.identity_ms
        self._times["challenge"] = now_ms + self._challenge_delay_ms

    def _range(self, now_ms: int, actions: list[do.PadAction]) -> None:
        """Step 5: what ranging brought by now."""
        enough, estimate = self._ranging.advance(now_ms)
        if estimate is not None:
            actions.append(estimate)
        if enough:
            self._confirm(now_ms, actions)
        else:
            self._words.tell(self._gathered, now_ms, final=False)

    def _confirm(self, now_ms: int, actions: list[do.PadAction]) -> None:
        """Step 5 is over; step 6: tell all ranges and ask for the countersignature."""
        self._reach("range", self._gathered.last_ms, actions)
        self._gathered.frozen = self._frames.frozen = True
        self.phase = Phase.CONFIRMING
        if "challenge" in self._times:  # ranging was over before its moment came
            self._send_challenge(now_ms)
        self._words.tell(self._gathered, now_ms, final=True)
        self._times["confirm"] = now_ms + self._timing.confirm_ms

    def _send_challenge(self, now_ms: int) -> None:
        self._times.pop("challenge", None)
        self._words.challenge(self._challenge, now_ms)
        self._asked_ms = now_ms
        self._frames.expect(self._answer)
        self._times["echo"] = now_ms + self._timing.echo_ms

    def _echoed(self, challenge: bytes, uav_ms: int, now_ms: int, actions: list[do.PadAction]) -> None:
        if "echo" not in self._times:
            self._fail("out_of_turn", "an echo without a challenge", now_ms, actions)
        elif not hmac.compare_digest(challenge, self._challenge):
            self._fail("echo_mismatch", "the echo is not the challenge's", now_ms, actions)
        else:
            del self._times["echo"]
            self._gathered.read_clock(uav_ms, now_ms, self._asked_ms)

    def _signed(self, signature: bytes, now_ms: int, actions: list[do.PadAction]) -> None:
        """Step 6, the answer. Whether it holds, the contract decides; the pad says what it saw."""
        if self.phase is not Phase.CONFIRMING:
            self._fail("out_of_turn", "a countersignature before the ranges", now_ms, actions)
            return
        self._signature = to_base64url(signature)
        holds = self._words.signature_holds(signature, self._gathered)
        self._reach("confirm", now_ms, actions, ok=holds, detail="" if holds else "the signature does not fit")
        if "echo" in self._times or "identity" in self._times:
            self._fail("challenge_unanswered", "signed without answering challenge and identity", now_ms, actions)
            return
        self._times.pop("confirm", None)
        if self._awaits_witness:
            self._times["witness"] = now_ms + self._timing.witness_ms
        else:
            self._submit(now_ms, actions)

    def _submit(self, now_ms: int, actions: list[do.PadAction]) -> None:
        """Step 7: submit the evidence to the ledger."""
        self.phase = Phase.SUBMITTING
        self._times.clear()
        self._gathered.frozen = self._frames.frozen = True
        actions.append(do.Submit(self._evidence(now_ms)))

    def _evidence(self, now_ms: int) -> Evidence:
        self._broadcasts.listen(self._since_ms(now_ms), now_ms, whole=True)
        return self._gathered.evidence(
            matched=self._matched,
            broadcast=self._broadcasts.chosen(self._gathered.attested),
            radio=Radio(
                measured_by=self._measured_by,
                sts=self._sts,
                firmware=self._firmware,
                attempted_rounds=self._ranging.attempted if self._measured_by == "pad" else None,
            ),
            uav_signature=self._signature,
            failure=self._failure,
            time_stamps=self._frames.stamps(),
            drift_sigma_mm=self._drift_sigma_mm,
        )

    def _since_ms(self, now_ms: int) -> int:
        """From when on broadcasts may be judged by the drone's claims."""
        table = self._gathered.table(0, 1)
        return (table.t_ms[0] if table.t_ms else now_ms) - NEAR_CLAIM_MS

    def _decided(self, event: on.VerdictCommitted, now_ms: int, actions: list[do.PadAction]) -> None:
        """Step 8: the verdict is in a block."""
        if self.phase is not Phase.SUBMITTING:
            return
        self.verdict = event.verdict
        granted = event.verdict.permission == "granted"
        self._reach("verdict", now_ms, actions, detail=event.verdict.outcome)
        if granted:
            self.phase = Phase.PERMITTED
            actions.append(do.Permit(event.verdict))
            if self.session.action in GUIDED:
                self._times["guided"] = now_ms + self._timing.silence_ms
            else:
                actions.append(do.CloseRadios())
            self._times["permission"] = max(
                self.session.expires_ms + self._timing.lapse_margin_ms, now_ms + self._timing.completion_ms
            )
        else:
            actions.append(do.ReportStep("permission", now_ms, ok=False, detail="refused"))
            actions.append(do.CloseRadios())
            self._end("decided", "refused", now_ms, actions, tx_id=event.tx_id)

    def _guided(self, event: on.AnchorRange, now_ms: int) -> None:
        """A range while the drone acts: it finds its way down by what it measures itself; nothing is judged here."""
        if "guided" in self._times and event.range_mm is not None:
            self._times["guided"] = now_ms + self._timing.silence_ms

    def _refused(self, event: on.SubmitRefused, now_ms: int, actions: list[do.PadAction]) -> None:
        if self.phase is not Phase.SUBMITTING:
            return
        actions.append(do.ReportStep("verdict", now_ms, ok=False, detail=event.detail))
        self._cancel(event.reason, event.detail, now_ms, actions)

    def _cancelled(self, event: on.SessionCancelled, now_ms: int, actions: list[do.PadAction]) -> None:
        if self.phase is Phase.PERMITTED:
            actions.append(do.Withdraw(event.reason))
        actions.append(do.CloseRadios())
        self._end("cancelled", event.reason, now_ms, actions, detail=f"by {event.by}")

    def _completed(self, event: on.InteractionCompleted, now_ms: int, actions: list[do.PadAction]) -> None:
        if self.phase is Phase.PERMITTED:
            actions.extend((do.Withdraw("completed"), do.CloseRadios()))
        self._end("completed", event.end, now_ms, actions)

    def _interrupted(self, event: on.Interrupted, now_ms: int, actions: list[do.PadAction]) -> None:
        """The agent has to stop. A verdict under way is left to the ledger; a permission is taken back."""
        if self.phase is Phase.PERMITTED:
            actions.extend((do.Withdraw(event.reason), do.CloseRadios()))
            self._end("decided", event.reason, now_ms, actions, detail=event.detail)
        elif self.phase is Phase.SUBMITTING:
            actions.append(do.CloseRadios())
            self._end("requested", event.reason, now_ms, actions, detail=event.detail)
        else:
            self._cancel(event.reason, event.detail, now_ms, actions)

    # --- time --------------------------------------------------------------------------------------------------

    def _time_passed(self, now_ms: int, actions: list[do.PadAction]) -> None:
        if self.phase is Phase.RANGING:
            self._range(now_ms, actions)
        due = {name for name, t_ms in self._times.items() if now_ms >= t_ms}
        match self.phase:
            case Phase.OPENING if "open" in due:
                self._cancel("radios_unavailable", "the nodes did not open the sessions in time", now_ms, actions)
            case Phase.POLLING if "reply" in due or now_ms >= self._cutoff_ms:
                self._fail("no_reply", "the drone did not answer over UWB", now_ms, actions)
            case Phase.RANGING | Phase.CONFIRMING:
                self._ranging_time(due, now_ms, actions)
            case Phase.PERMITTED if "guided" in due:
                del self._times["guided"]
                actions.append(do.CloseRadios())
            case Phase.PERMITTED if "permission" in due:
                actions.extend((do.Withdraw("permission_expired"), do.CloseRadios()))
                actions.append(do.Cancel("permission_expired", "the drone did not complete in time"))
                self._end("cancelled", "permission_expired", now_ms, actions)
            case _:
                pass

    def _ranging_time(self, due: set[str], now_ms: int, actions: list[do.PadAction]) -> None:
        if "challenge" in due and self.phase is Phase.RANGING:
            self._send_challenge(now_ms)
        if "echo" in due:
            self._fail("no_echo", "the drone did not answer the challenge", now_ms, actions)
        elif "identity" in due:
            self._fail("no_identity", "the drone did not say who it is", now_ms, actions)
        elif "witness" in due:  # the contract judges without it, and says so
            self._submit(now_ms, actions)
        elif "confirm" in due:
            self._fail("not_countersigned", "the drone did not countersign the ranges", now_ms, actions)
        elif now_ms >= self._cutoff_ms:
            self._fail("out_of_time", "the session is about to expire", now_ms, actions)
        elif self.phase is Phase.RANGING and now_ms >= self._ranging.silent_ms:
            partial = self._ranging.partial
            reason = "too_few_anchors" if partial else "drone_lost"
            self._fail(reason, f"{partial} rounds with fewer than {MIN_ANCHORS} ranges", now_ms, actions)

    # --- ends --------------------------------------------------------------------------------------------------

    def _fail(self, reason: str, detail: str, now_ms: int, actions: list[do.PadAction]) -> None:
        """Something broke after the poll: the contract judges what there is, with the reason."""
        if self.phase not in {Phase.POLLING, Phase.RANGING, Phase.CONFIRMING}:
            return
        self._failure = reason
        steps: dict[Phase, StepName] = {Phase.POLLING: "reply", Phase.RANGING: "range", Phase.CONFIRMING: "confirm"}
        step = steps[self.phase]
        if self.phase is Phase.POLLING and "poll" not in self._gathered.steps:
            step = "poll"
        actions.append(do.ReportStep(step, now_ms, ok=False, detail=f"{reason}: {detail}" if detail else reason))
        self._submit(now_ms, actions)

    def _cancel(self, reason: str, detail: str, now_ms: int, actions: list[do.PadAction]) -> None:
        actions.extend((do.CloseRadios(), do.Cancel(reason, detail)))
        self._end("cancelled", reason, now_ms, actions, detail=detail)

    def _end(
        self, state: str, end: str, now_ms: int, actions: list[do.PadAction], *, tx_id: str = "", detail: str = ""
    ) -> None:
        self.phase = Phase.ENDED
        self._times.clear()
        self._words.close()
        actions.append(do.Finish(state, end, now_ms, tx_id, detail))

    def _reach(
        self, step: StepName, t_ms: int, actions: list[do.PadAction], *, ok: bool = True, detail: str = ""
    ) -> None:
        if self._gathered.reach(step, t_ms):
            actions.append(do.ReportStep(step, t_ms, ok=ok, detail=detail))


_ABORTS: Final = {
    AbortReason.CODE_MISMATCH: "drone_saw_code_mismatch",
    AbortReason.IDENTITY_MISMATCH: "drone_saw_identity_mismatch",
    AbortReason.TIMEOUT: "drone_timed_out",
    AbortReason.RANGES_REFUSED: "ranges_refused",
    AbortReason.CANCELLED: "drone_cancelled",
}
