"""The drone's side of one proof as an explicit state machine: events in, actions out, no I/O.

Phases and the steps of the paper that they hold:

* OPENING: RequestProof is VALID (1); the node is being told the sessions.
* LISTENING (2, 3, 4): the drone waits for the pad's poll, matches its code and replies with its own.
* RANGING (5): it streams claims, says who it is, echoes the challenge.
* SIGNING, WAITING (6, 7): it was told all ranges, compared them with its own, and countersigns; the contract decides.
* ACTING (8): a committed verdict permits it.
* ENDED.

Nothing is done on the strength of a word over UWB but ranging: the permission is the committed verdict alone.
"""

from __future__ import annotations

import hmac
from collections.abc import Callable, Sequence
from enum import Enum
from typing import Final

from wonderland.proofs.encoding import to_base64url
from wonderland.proofs.keys import SessionKeys
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.sessions import MAX_ATTESTED, MAX_CLAIMS, AnchorRanges, Claim, RangeTable, Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.statement import statement
from wonderland.session.pace import pace_of
from wonderland.session.words import Word
from wonderland.telemetry import StepName
from wonderland.uwb.agreed import agreed_plan
from wonderland.uwb.blinks import BlinkPlan
from wonderland.uwb.layout import RangingPlan
from wonderland.uwb.link.messages import AbortReason
from wonderland.uwb.link.proof_payloads import RangesPart
from wonderland_uav_agent.session import actions as do
from wonderland_uav_agent.session import events as on
from wonderland_uav_agent.session.crosscheck import OwnRanges
from wonderland_uav_agent.session.timing import UavTiming
from wonderland_uav_agent.session.words import UavWords

Claims = Callable[[int], Claim | None]
"""The drone's position at a time (ms); None while it has none."""
Broadcasts = Callable[[int], Sequence[bytes]]
"""Digests of the Remote ID positions that the drone has broadcast since a time (ms), oldest first."""

_ABORTS: Final = {
    "identity_mismatch": AbortReason.IDENTITY_MISMATCH,
    "ranging_timeout": AbortReason.TIMEOUT,
    "pad_silent": AbortReason.TIMEOUT,
    "radios_lost": AbortReason.INTERNAL,
}
RESERVED_CLAIMS: Final = 2
"""Kept for the end: the claim of the last rounds is the one that matters most."""


class Phase(Enum):
    """Where a session stands on the drone."""

    OPENING = "opening"
    LISTENING = "listening"
    RANGING = "ranging"
    SIGNING = "signing"
    WAITING = "waiting"
    ACTING = "acting"
    ENDED = "ended"


class UavSession:
    """One proof of one drone.

    ``session`` and ``commissioning`` come from the ledger, ``keys`` from their transcript. ``certificate`` is the
    drone's own (DER); it is said whole instead of by its hash where ``whole_certificate`` is set. ``guided``: the node
    ranges on while the drone lands by what it measures. All times are milliseconds on one steady clock.
    """

    def __init__(
        self,
        session: Session,
        commissioning: Commissioning,
        keys: SessionKeys,
        *,
        certificate: bytes,
        claims: Claims,
        now_ms: int,
        timing: UavTiming | None = None,
        whole_certificate: bool = False,
        measures: bool = True,
        witness_blinks: BlinkPlan | None = None,
        broadcasts: Broadcasts = lambda _since_ms: (),
        guided: bool = False,
    ) -> None:
        self.session: Final = session
        self.commissioning: Final = commissioning
        self.phase = Phase.OPENING
        self.verdict: Verdict | None = None
        self.failure = ""
        """Why the drone stopped taking part before the verdict; empty where it did not."""
        self.steps: dict[StepName, int] = {}
        self._timing = timing or UavTiming()
        self._claims_now = claims
        self._broadcasts = broadcasts
        self._since_ms = now_ms
        self._code_pad = keys.code_pad
        self._macs = {anchor.anchor_id: anchor.mac for anchor in commissioning.anchors}
        self._plan = agreed_plan(keys, commissioning, session.node, witness_blinks)
        pace = pace_of(self._plan)
        self._timing = self._timing.paced(pace)
        self._answer = keys.answer
        self._words = UavWords(
            session,
            keys,
            tuple(self._macs),
            certificate=certificate,
            whole_certificate=whole_certificate,
            now_ms=now_ms,
            word_octets=self._plan.word_octets,
            pace=pace,
        )
        self._own, self._measures = OwnRanges(), measures
        self._claims: list[Claim] = []
        self._t_ms: list[int] = []
        self._columns: dict[str, list[int]] = {anchor_id: [] for anchor_id in self._macs}
        self._radios_open = False
        self._guided = guided and session.action in {"land", "dock"}
        self._times: dict[str, int] = {
            "open": now_ms + self._timing.open_ms,
            "expiry": session.expires_ms + self._timing.verdict_grace_ms,
        }

    @property
    def plan(self) -> RangingPlan:
        """What the node is told."""
        return self._plan

    def start(self, now_ms: int) -> list[do.UavAction]:
        """First actions: the request is on the ledger, the node is opened."""
        actions: list[do.UavAction] = []
        self._reach("request", now_ms, actions)
        actions.append(do.OpenRadios(self._plan))
        return actions

    def handle(self, event: on.UavEvent, now_ms: int) -> list[do.UavAction]:
        """Take one event at this time; returns what is to be done, in order."""
        actions: list[do.UavAction] = []
        if self.phase is Phase.ENDED:
            return actions
        match event:
            case on.OwnRange():
                self._own.add(event.mac, event.t_ms, event.range_mm)
            case on.DataHeard():
                self._words.receive(event.data, now_ms)
            case on.RadiosOpened():
                self._radios_opened()
            case on.RadiosFailed():
                self._radios_failed(event, now_ms, actions)
            case on.Signed():
                self._signed(event, now_ms, actions)
            case on.SignFailed():
                self._refuse("signing_failed", event.detail, now_ms, actions)
            case on.VerdictCommitted():
                self._decided(event, now_ms, actions)
            case on.SessionCancelled():
                self._cancelled(event, now_ms, actions)
            case on.Acted():
                self._acted(event, now_ms, actions)
            case on.Interrupted():
                self._interrupted(event, now_ms, actions)
            case on.Tick():
                pass
        self._words_heard(now_ms, actions)
        self._time_passed(now_ms, actions)
        return actions

    def frames_to_send(self, now_ms: int) -> list[bytes]:
        """Frames for one data unit of the node; call it when ``next_frames_ms`` has come."""
        return self._words.frames_to_send(now_ms) if self._speaks else []

    def next_frames_ms(self) -> int | None:
        """When ``frames_to_send`` will have something; None while all is quiet."""
        return self._words.next_wakeup_ms() if self._speaks else None

    @property
    def _speaks(self) -> bool:
        return self._radios_open and self.phase is not Phase.ACTING

    def next_tick_ms(self) -> int | None:
        """When the machine wants a Tick if nothing else happens; None once it has ended."""
        return None if self.phase is Phase.ENDED else min(self._times.values(), default=None)

    # --- the steps ---------------------------------------------------------------------------------------------

    def _radios_opened(self) -> None:
        if self.phase is Phase.OPENING:
            self._times.pop("open", None)
            self._radios_open = True
            self.phase = Phase.LISTENING

    def _radios_failed(self, event: on.RadiosFailed, now_ms: int, actions: list[do.UavAction]) -> None:
        if self.phase in {Phase.OPENING, Phase.LISTENING}:
            self._give_up("radios_unavailable", event.detail, now_ms, actions)
        elif self.phase in {Phase.RANGING, Phase.SIGNING}:
            self._broken("radios_lost", event.detail, now_ms, actions)

    def _words_heard(self, now_ms: int, actions: list[do.UavAction]) -> None:
        """Steps 2 to 6 as far as the pad's words carry them."""
        for heard in self._words.heard():
            if self.phase in {Phase.OPENING, Phase.ACTING, Phase.ENDED}:
                return
            match heard.word:
                case Word.POLL:
                    self._polled(heard.octets, now_ms, actions)
                case Word.CHALLENGE if self.phase in {Phase.RANGING, Phase.SIGNING}:
                    self._words.echo(heard.octets, now_ms)
                    if self._plan.blinks is not None:
                        actions.append(do.AnswerInBlinks(self._answer(heard.octets)))
                case Word.RANGES if heard.ranges is not None:
                    self._told(heard.ranges, now_ms, actions)
                case Word.REPLY_DELIVERED | Word.IDENTITY | Word.SIGNATURE_DELIVERED:
                    pass
                case Word.ABORT:
                    self._broken(f"pad_{heard.abort.name.lower()}", heard.detail, now_ms, actions)
                case Word.BROKEN:
                    self._broken(heard.reason, heard.detail, now_ms, actions)
                case _:
                    self._broken("out_of_turn", f"{heard.word.value} while {self.phase.value}", now_ms, actions)
            if self.phase is Phase.RANGING:
                self._times["pad_silence"] = now_ms + self._timing.pad_silence_ms

    def _polled(self, code: bytes, now_ms: int, actions: list[do.UavAction]) -> None:
        """Steps 2 to 4: the pad's code, and the answer."""
        if self.phase is not Phase.LISTENING:
            self._broken("out_of_turn", "a second poll", now_ms, actions)
            return
        self._reach("poll", now_ms, actions)
        if not hmac.compare_digest(code, self._code_pad):
            self._words.abort(AbortReason.CODE_MISMATCH, now_ms)
            actions.append(do.ReportStep("match", now_ms, ok=False, detail="the pad's session code is another's"))
            self._wait("code_mismatch")
            return
        self._reach("match", now_ms, actions)
        self._words.reply(now_ms)
        self._reach("reply", now_ms, actions)
        self.phase = Phase.RANGING
        self._times["ranging"] = now_ms + self._timing.ranging_ms
        self._times["claim"] = now_ms
        self._times["pad_silence"] = now_ms + self._timing.pad_silence_ms

    def _claim(self, now_ms: int, *, reserve: int) -> None:
        if len(self._claims) >= MAX_CLAIMS - reserve:
            return
        claim = self._claims_now(now_ms)
        # A source whose clock is set back would have the contract read claims that go backwards: it waits for them.
        if claim is not None and (not self._claims or claim.t_ms >= self._claims[-1].t_ms):
            self._words.claim(len(self._claims), claim, now_ms)
            self._claims.append(claim)

    def _told(self, part: RangesPart, now_ms: int, actions: list[do.UavAction]) -> None:
        """Step 6: ranges to countersign, in parts that follow on one another."""
        if self.phase is not Phase.RANGING or part.first_round != len(self._t_ms):
            self._broken("out_of_turn", "ranges that do not follow on those before", now_ms, actions)
            return
        self._t_ms.extend(part.table.t_ms)
        for anchor in part.table.anchors:
            self._columns[anchor.anchor_id].extend(anchor.range_mm)
        if not part.final:
            return
        self._reach("range", now_ms, actions)
        table = RangeTable(
            t_ms=tuple(self._t_ms),
            anchors=tuple(
                AnchorRanges(anchor_id=name, range_mm=tuple(column)) for name, column in self._columns.items()
            ),
        )
        comparison = self._own.compare(table, self._macs, now_ms)
        if self._measures and comparison.refusal:
            detail = f"{comparison.pairs} of {comparison.told} ranges compared, median {comparison.median_mm} mm apart"
            self._refuse(comparison.refusal, detail, now_ms, actions)
            return
        self._claim(now_ms, reserve=0)
        self.phase = Phase.SIGNING
        self._times.pop("claim", None)
        self._times.pop("ranging", None)
        self._times.pop("pad_silence", None)
        self._sign(table, now_ms, actions)

    def _sign(self, table: RangeTable, now_ms: int, actions: list[do.UavAction]) -> None:
        """Say which broadcasts are its own, and sign for all that was said."""
        digests = tuple(self._broadcasts(self._since_ms))[-MAX_ATTESTED:]
        if digests:
            self._words.attest(digests, now_ms)
        session = self.session
        attested = [to_base64url(digest) for digest in digests]
        actions.append(
            do.Sign(statement(session.session_id, session.transcript_sha256, table, tuple(self._claims), attested))
        )

    def _signed(self, event: on.Signed, now_ms: int, actions: list[do.UavAction]) -> None:
        if self.phase is Phase.SIGNING:
            self._words.countersign(event.signature, now_ms)
            self._reach("confirm", now_ms, actions)
            self._wait("")

    def _refuse(self, reason: str, detail: str, now_ms: int, actions: list[do.UavAction]) -> None:
        """The drone does not sign: it says so, and the contract judges without it."""
        if self.phase not in {Phase.RANGING, Phase.SIGNING}:
            return
        self._words.abort(AbortReason.RANGES_REFUSED, now_ms, reason)
        actions.append(do.ReportStep("confirm", now_ms, ok=False, detail=f"{reason}: {detail}"))
        self._wait(reason)

    def _broken(self, reason: str, detail: str, now_ms: int, actions: list[do.UavAction]) -> None:
        """The exchange with the pad is over; the pad still brings what it has before the contract."""
        if self.phase is Phase.WAITING:
            return
        self._words.abort(_ABORTS.get(reason, AbortReason.UNSPECIFIED), now_ms, reason)
        steps: dict[Phase, StepName] = {Phase.LISTENING: "poll", Phase.RANGING: "range"}
        step = steps.get(self.phase, "confirm")
        actions.append(do.ReportStep(step, now_ms, ok=False, detail=f"{reason}: {detail}" if detail else reason))
        self._wait(reason)

    def _wait(self, failure: str) -> None:
        """Wait for the ledger's word; ``failure`` says what went wrong, if something did."""
        self.phase = Phase.WAITING
        self.failure = failure
        for name in ("claim", "ranging", "pad_silence"):
            self._times.pop(name, None)

    def _decided(self, event: on.VerdictCommitted, now_ms: int, actions: list[do.UavAction]) -> None:
        """Steps 7 and 8: the verdict is in a block."""
        if self.phase is Phase.ACTING:
            return
        self.verdict = event.verdict
        granted = event.verdict.permission == "granted"
        if not (granted and self._guided):
            self._close_radios(actions)
        self._reach("verdict", now_ms, actions, detail=event.verdict.outcome)
        if granted:
            self._reach("permission", now_ms, actions, detail="granted")
            self.phase = Phase.ACTING
            self._times.clear()
            self._times["act"] = now_ms + self._timing.act_ms
            actions.append(do.Act(event.verdict))
        else:
            actions.append(do.ReportStep("permission", now_ms, ok=False, detail="refused"))
            self._end("decided", "refused", now_ms, actions, detail=self.failure)

    def _acted(self, event: on.Acted, now_ms: int, actions: list[do.UavAction]) -> None:
        if self.phase is Phase.ACTING:
            actions.append(do.Complete(event.result, event.detail))
            self._end("completed", event.result, now_ms, actions, detail=event.detail)

    def _cancelled(self, event: on.SessionCancelled, now_ms: int, actions: list[do.UavAction]) -> None:
        if self.phase is Phase.ACTING:
            actions.append(do.StopActing(event.reason))
        self._end("cancelled", event.reason, now_ms, actions, detail=event.note or f"ended by the {event.by}")

    def _interrupted(self, event: on.Interrupted, now_ms: int, actions: list[do.UavAction]) -> None:
        if self.phase is Phase.ACTING:
            actions.extend((do.StopActing(event.reason), do.Complete("aborted", event.detail or event.reason)))
            self._end("completed", "aborted", now_ms, actions, detail=event.reason)
        elif self.phase is Phase.WAITING:  # the pad's evidence is on its way: the ledger ends this one
            self._end("requested", event.reason, now_ms, actions, detail=event.detail)
        else:
            self._give_up(event.reason, event.detail, now_ms, actions)

    # --- time and ends -----------------------------------------------------------------------------------------

    def _time_passed(self, now_ms: int, actions: list[do.UavAction]) -> None:
        for name in [name for name, t_ms in self._times.items() if now_ms >= t_ms]:
            if name not in self._times:  # taken out by what happened just before
                continue
            match name:
                case "claim":
                    self._claim(now_ms, reserve=RESERVED_CLAIMS)
                    fast = len(self._claims) < self._timing.fast_claims
                    self._times["claim"] = now_ms + (
                        self._timing.claim_interval_ms if fast else self._timing.slow_claim_interval_ms
                    )
                case "open":
                    self._give_up("radios_unavailable", "the node did not open the sessions", now_ms, actions)
                case "ranging":
                    self._broken("ranging_timeout", "the pad did not tell the ranges", now_ms, actions)
                case "pad_silence":
                    self._broken("pad_silent", "no word from the pad any more", now_ms, actions)
                case "expiry":
                    self._expired(now_ms, actions)
                case "act":
                    actions.append(do.StopActing("act_timeout"))
                    self._acted(on.Acted("aborted", "it took too long"), now_ms, actions)

    def _expired(self, now_ms: int, actions: list[do.UavAction]) -> None:
        self._give_up("no_poll" if self.phase is Phase.LISTENING else "no_verdict", "", now_ms, actions)

    def _give_up(self, reason: str, detail: str, now_ms: int, actions: list[do.UavAction]) -> None:
        actions.append(do.Cancel(reason, detail))
        self._end("cancelled", reason, now_ms, actions, detail=detail)

    def _end(self, state: str, end: str, now_ms: int, actions: list[do.UavAction], *, detail: str = "") -> None:
        self._close_radios(actions)
        self.phase = Phase.ENDED
        self._times.clear()
        self._words.close()
        actions.append(do.Finish(state, end, now_ms, detail=detail))

    def _close_radios(self, actions: list[do.UavAction]) -> None:
        if self._radios_open or self.phase is Phase.OPENING:
            self._radios_open = False
            actions.append(do.CloseRadios())

    def _reach(self, step: StepName, t_ms: int, actions: list[do.UavAction], *, detail: str = "") -> None:
        if step not in self.steps:
            self.steps[step] = t_ms
            actions.append(do.ReportStep(step, t_ms, detail=detail))
