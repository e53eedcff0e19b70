"""A pad, a session and evidence to judge, made from a seed."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import replace

from wonderland.proofs import frame as frames
from wonderland.proofs.differences import MM_PER_TICK
from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning, Frame
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import (
    NO_TICK,
    AnchorRanges,
    AnchorTicks,
    BroadcastClaim,
    Claim,
    Evidence,
    Party,
    Radio,
    RangeTable,
    Session,
    Testimony,
    TimeStamps,
)

FRAME = Frame(
    lat_e7=604_518_000,
    lon_e7=222_666_000,
    height_mm=30_000,
    e1=23_627_000_000,
    e2=-92_000_000,
    e3=3_700_000,
    n1=47_900_000_000,
    n2=0,
    n3=40_000_000,
    n4=7_800_000,
    u2=-87_000_000,
    u3=-21_000_000,
)
START_MS = 1_800_000_000_000
SQUARE = ((1500, 1500), (-1500, 1500), (-1500, -1500), (1500, -1500))


class World:
    """Builds sessions whose truth is known."""

    def __init__(
        self,
        seed: int = 1,
        anchors: Sequence[tuple[int, int]] = SQUARE,
        sigma_mm: int = 25,
        bias_sigma_mm: int = 5,
        *,
        start_ms: int = START_MS,
        frame: Frame = FRAME,
    ) -> None:
        self.start_ms = start_ms
        self.frame = frame
        self.rng = random.Random(seed)
        self.sigma_mm = sigma_mm
        self.commissioning = Commissioning(
            frame=frame,
            anchors=tuple(
                Anchor(
                    anchor_id=f"A{i}",
                    mac=0xA000 + i,
                    east_mm=e,
                    north_mm=n,
                    up_mm=1200 if i == 0 else 200,
                    survey_sigma_mm=3,
                    bias=(BiasPoint(range_mm=0, bias_mm=0, sigma_mm=bias_sigma_mm),),
                )
                for i, (e, n) in enumerate(anchors)
            ),
            range_sigma_mm=sigma_mm,
            installation_sigma_mm=5,
            max_range_mm=100_000,
            valid_from_ms=0,
            valid_until_ms=self.start_ms * 2,
            method="simulated",
        )

    def claim(self, local: tuple[float, float, float], t_ms: int, **more: int) -> Claim:
        lat, lon, height = frames.to_wgs84(self.frame, *(round(value) for value in local))
        return Claim(
            lat_e7=lat,
            lon_e7=lon,
            height_mm=height,
            t_ms=t_ms,
            **{"accuracy_mm": 100, "height_accuracy_mm": 200, **more},
        )

    def session(self, claim: Claim, **policy: int) -> Session:
        party = Party(msp_id="PadMSP", certificate_sha256="0" * 64)
        return Session(
            session_id="0" * 64,
            state="requested",
            pad_id="pad-1",
            uav_id="uav-1",
            action="land",
            claim=claim,
            prekey_id="k1",
            pad_key="A" * 87,
            uav_key="A" * 87,
            pad=party,
            uav=party,
            commissioning_sha256="0" * 64,
            contract_version="1.0",
            transcript_sha256="0" * 64,
            policy=Policy(**policy),
            requested_ms=self.start_ms,
            expires_ms=self.start_ms + 60_000,
        )

    def evidence(
        self,
        truth,
        claimed,
        *,
        rounds: int = 40,
        bias_mm: Sequence[float] = (0, 0, 0, 0, 0, 0),
        broadcast=None,
        claimed_rounds: int | None = None,
        **more,
    ) -> Evidence:
        """``truth`` and ``claimed`` are functions of milliseconds since the start → (east, north, up) in mm."""
        times = [500 + 50 * i for i in range(rounds)]
        columns = []
        for index, anchor in enumerate(self.commissioning.anchors):
            ranges = []
            for t in times:
                distance = math.dist(truth(t), (anchor.east_mm, anchor.north_mm, anchor.up_mm))
                ranges.append(max(0, round((distance + bias_mm[index] + self.rng.gauss(0, self.sigma_mm)) / 10) * 10))
            columns.append(AnchorRanges(anchor_id=anchor.anchor_id, range_mm=tuple(ranges)))
        until = 700 + 50 * (claimed_rounds or rounds)
        claims = tuple(self.claim(claimed(t), self.start_ms + t) for t in range(400, until, 200))
        heard = ()
        if broadcast is not None:
            heard = tuple(
                BroadcastClaim(lat_e7=c.lat_e7, lon_e7=c.lon_e7, height_mm=c.height_mm, t_ms=c.t_ms)
                for c in (self.claim(broadcast(t), self.start_ms + t) for t in range(500, 700 + 50 * rounds, 1000))
            )
        return Evidence(
            ranges=RangeTable(t_ms=tuple(self.start_ms + t for t in times), anchors=tuple(columns)),
            claims=claims,
            broadcast=heard,
            **{"matched": "both", "radio": Radio(measured_by="pad", sts="provisioned"), "steps": (), **more},
        )

    def share_a_clock(self, *, timestamp_sigma_mm: int = 30, clock_sigma_mm: int = 5) -> None:
        """Commission the pad for time stamps."""
        self.commissioning = replace(
            self.commissioning,
            timestamp_sigma_mm=timestamp_sigma_mm,
            anchors=tuple(replace(anchor, clock_sigma_mm=clock_sigma_mm) for anchor in self.commissioning.anchors),
        )

    def stamps(
        self,
        truth,
        *,
        frames: int = 60,
        sigma_mm: float = 30.0,
        clock_mm: Sequence[float] = (),
        deaf: Sequence[tuple[int, int]] = (),
        bound_by: str = "challenge",
    ) -> TimeStamps:
        """Frames sent where ``truth`` says; ``clock_mm``: error of each anchor's clock; ``deaf``: (anchor, frame)."""
        errors = clock_mm or (0.0,) * len(self.commissioning.anchors)
        columns: list[list[int]] = [[] for _ in self.commissioning.anchors]
        for number in range(frames):
            place = truth(500 + 50 * number)
            stamps = []
            for anchor, error in zip(self.commissioning.anchors, errors, strict=True):
                away = math.dist(place, (anchor.east_mm, anchor.north_mm, anchor.up_mm))
                stamps.append((away + error + self.rng.gauss(0, sigma_mm)) / MM_PER_TICK)
            first = min(stamps)
            for index, (column, stamp) in enumerate(zip(columns, stamps, strict=True)):
                column.append(NO_TICK if (index, number) in deaf else round(stamp - first))
        return TimeStamps(
            start_ms=self.start_ms + 500,
            gap_ms=(0,) + (50,) * (frames - 1),
            anchors=tuple(
                AnchorTicks(anchor_id=anchor.anchor_id, ticks=tuple(column))
                for anchor, column in zip(self.commissioning.anchors, columns, strict=True)
            ),
            bound_by=bound_by,
        )

    def testimony(self, truth, **more) -> Testimony:
        """What this pad brings as a witness of a drone; ``truth`` is in the frame that all pads of the tests share."""
        return Testimony(
            session_id="0" * 64,
            pad_id="pad-2",
            msp_id="OtherPadMSP",
            certificate_sha256="0" * 64,
            commissioning_sha256="0" * 64,
            radio=Radio(measured_by="pad", sts="provisioned"),
            time_stamps=self.stamps(truth, **{"bound_by": "key", **more}),
            testified_ms=self.start_ms + 5_000,
        )
