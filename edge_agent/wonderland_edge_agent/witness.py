"""The pad as a witness of another pad's proof: it only listens, time-stamps the drone's blinks, and testifies.

Nothing is said over the air and nothing is believed but this pad's own clocks. The keys come from the prekey of this
pad that the drone's request consumed, so that nobody else can make blinks that this pad takes for the drone's.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, Protocol

from wonderland.proof_contract import AwayError, Committed, RefusedError
from wonderland.proofs import keys as session_keys
from wonderland.proofs.differences import MIN_FRAMES, frames_needed, halved
from wonderland.proofs.encoding import from_base64url
from wonderland.proofs.errors import GeometryError, ProofError
from wonderland.proofs.frame import to_local
from wonderland.proofs.honest import narrowed
from wonderland.proofs.keys import SessionKeys
from wonderland.proofs.records.pads import Commissioning, Pad
from wonderland.proofs.records.sessions import Radio, Session, Testimony, TimeStamps
from wonderland.proofs.transcript import transcript_of
from wonderland.uwb.agreed import witness_plan
from wonderland_edge_agent.radios import RadiosError
from wonderland_edge_agent.session import events as on
from wonderland_edge_agent.session.frames import FrameGatherer
from wonderland_edge_agent.spool import SpoolError

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric import ec

    from wonderland.clock import Clock
    from wonderland.uwb.blinks import BlinkPlan
    from wonderland_edge_agent.session.ports import Sink

_log = logging.getLogger(__name__)

SILENCE_MS: Final = 12_000
"""Without a blink for so long the drone is not there, or not heard."""
MIN_SESSION_MS: Final = 3_000
"""With less time than this before its expiry nothing is begun."""
RESERVE_MS: Final = 3_000
"""Kept free before the session expires, so that the pad can still submit."""
LOOK_S: Final = 0.05
RETRY_S: Final = 0.3
FEWEST: Final = 20
MOST: Final = 200
MARGIN: Final = 2
"""Times the frames that settle the claim of nine honest drones in ten, on average: some samples fall worse."""


class WitnessRadios(Protocol):
    """The nodes, as far as a witness needs them (``wonderland_edge_agent.radios.PadRadios``)."""

    async def listen(self, plan: BlinkPlan, anchor_ids: Sequence[str], sink: Sink) -> None:
        """Time-stamp blinks until ``close_session``; raises where no node can."""

    async def close_session(self) -> None:
        """End what `listen` began."""


class WitnessPrekeys(Protocol):
    """The pad's one-time keys (``wonderland_edge_agent.prekeys.PrekeyKeeper``)."""

    async def take_key(self, prekey_id: str) -> ec.EllipticCurvePrivateKey | None:
        """The private half of a prekey, once."""


class WitnessLedger(Protocol):
    """The ledger, as far as a witness needs it."""

    @property
    def channel(self) -> str:
        """Name of the ledger's channel."""
        ...

    async def read_pad(self, pad_id: str) -> Pad:
        """A pad with its commissioning."""
        ...

    async def witness_proof(
        self, session_id: str, radio: Radio, time_stamps: TimeStamps
    ) -> tuple[Testimony, Committed]:
        """Submit what this pad measured of another pad's session; it stands beside the proof."""
        ...

    async def read_session(self, session_id: str) -> Session:
        """A session as it stands."""
        ...


def frames_wanted(session: Session, commissioning: Commissioning) -> int:
    """How many blinks to wait for before testifying: enough for an honest drone, whose claim is not exact."""
    claim = session.claim
    try:
        east, north, up = to_local(commissioning.frame, claim.lat_e7, claim.lon_e7, claim.height_mm)
    except GeometryError:
        return FEWEST
    policy = narrowed(halved(session.policy))
    needed = frames_needed(commissioning, policy, float(east), float(north), float(up))
    return MOST if needed < 0 else max(FEWEST, min(MARGIN * needed, MOST))


class WitnessRun:
    """One session witnessed; ``run`` returns in one word how it ended."""

    def __init__(
        self,
        session: Session,
        commissioning: Commissioning,
        keys: SessionKeys,
        *,
        radios: WitnessRadios,
        ledger: WitnessLedger,
        clock: Clock,
        sts: str = "provisioned",
    ) -> None:
        self.session: Final = session
        self._answer = keys.answer(b"")
        self._plan = witness_plan(keys, commissioning, session.node)
        self._commissioning = commissioning
        self._wanted = frames_wanted(session, commissioning)
        self._anchor_ids = [anchor.anchor_id for anchor in commissioning.anchors]
        self._frames = FrameGatherer(self._anchor_ids, "key")
        self._frames.expect(self._answer)
        self._radios = radios
        self._ledger = ledger
        self._clock = clock
        self._radio = Radio(measured_by="pad", sts=sts)
        self._heard_ms = 0
        self._over = False

    def ended(self) -> None:
        """The session was decided or cancelled: nobody waits for this witness any more."""
        self._over = True

    async def run(self) -> str:
        """Listen, then testify. Raises what ``listen`` raises."""
        if self._plan is None:
            return "no_common_clock" if self._commissioning.timestamp_sigma_mm is None else "no_common_channel"
        await self._radios.listen(self._plan, self._anchor_ids, self._take)
        try:
            reason = await self._gather()
        finally:
            await self._radios.close_session()
        stamps = self._frames.stamps()
        if stamps is None or self._frames.frames < MIN_FRAMES or self._over:
            return reason or "too_few_frames"
        return await self._testify(stamps)

    def _take(self, event: on.PadEvent) -> None:
        if isinstance(event, on.FrameHeard):
            self._heard_ms = event.t_ms
            self._frames.add(event.anchor_id, event.t_ms, event.number, event.ticks, event.payload)

    async def _gather(self) -> str:
        """Until there are enough blinks; else why there are not."""
        self._heard_ms = self._clock()
        deadline_ms = self.session.expires_ms - RESERVE_MS
        while self._frames.frames < self._wanted:
            now_ms = self._clock()
            self._frames.expire(now_ms)
            if self._over:
                return "session_ended"
            if now_ms >= deadline_ms:
                return "out_of_time"
            if now_ms - self._heard_ms >= SILENCE_MS:
                return "drone_not_heard"
            await asyncio.sleep(LOOK_S)
        return ""

    async def _testify(self, stamps: TimeStamps) -> str:
        while not self._over and self._clock() < self.session.expires_ms:
            try:
                await self._ledger.witness_proof(self.session.session_id, self._radio, stamps)
            except RefusedError as error:
                _log.info("session %.12s: not testified: %s", self.session.session_id, error)
                return "refused" if error.code != "TESTIMONY_EXISTS" else "testified"
            except AwayError as error:
                _log.warning("session %.12s: the ledger is away: %s", self.session.session_id, error)
                await asyncio.sleep(RETRY_S)
            else:
                return "testified"
        return "session_ended"


class WitnessDuty:
    """Serves, one after the other, the sessions of other pads that name this one as witness."""

    def __init__(
        self, pad_id: str, *, ledger: WitnessLedger, radios: WitnessRadios, prekeys: WitnessPrekeys, clock: Clock
    ) -> None:
        self._pad_id = pad_id
        self._ledger = ledger
        self._radios = radios
        self._prekeys = prekeys
        self._clock = clock
        self._running: WitnessRun | None = None

    def ended(self, session_id: object) -> None:
        """A session was decided; if it is the one under way, nobody waits any more."""
        if self._running is not None and self._running.session.session_id == session_id:
            self._running.ended()

    async def serve(self, session: Session) -> None:
        """Listen and testify. Whatever goes wrong, the other pad's proof goes without: it is logged, never raised."""
        try:
            end = await self._serve(session)
        except (AwayError, RefusedError, ProofError, RadiosError, SpoolError) as error:
            _log.warning("session %.12s: not witnessed: %s", session.session_id, error)
        else:
            _log.info("session %.12s: as witness of pad %s: %s", session.session_id, session.pad_id, end)
        finally:
            self._running = None

    async def _serve(self, session: Session) -> str:
        current, pad = await asyncio.gather(
            self._ledger.read_session(session.session_id), self._ledger.read_pad(self._pad_id)
        )
        named, found = current.witness, pad.commissioning
        if current.state != "requested" or self._clock() >= current.expires_ms - MIN_SESSION_MS:
            return "session_ended"
        digest = transcript_of(current, self._ledger.channel).digest()
        if digest.hex() != current.transcript_sha256:
            return "transcript_mismatch"
        if named is None or found is None or pad.commissioning_sha256 != named.commissioning_sha256:
            return "commissioning_changed"
        private_key = await self._prekeys.take_key(named.prekey_id)
        if private_key is None:
            return "prekey_lost"
        secret = session_keys.shared_secret(private_key, from_base64url(current.uav_key))
        self._running = WitnessRun(
            current,
            found,
            session_keys.derive(secret, digest),
            radios=self._radios,
            ledger=self._ledger,
            clock=self._clock,
        )
        return await self._running.run()
