"""The whole live path: virtual nodes on pseudo-terminals, a reference by UDP, the transaction on the embedded ledger."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import random
import socket
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from wonderland.proof_contract import ProofContract
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.reduction import bias_at
from wonderland_chaincode.contract import CONTRACT
from wonderland_edge_agent.commissioning.errors import PublishError, RadioError, StateError, SurveyError
from wonderland_edge_agent.commissioning.live.publish import Operator
from wonderland_edge_agent.commissioning.live.radios import TagPlan
from wonderland_edge_agent.commissioning.live.wizard import LiveSettings, Wizard
from wonderland_edge_agent.commissioning.survey_files import Origin
from wonderland_edge_agent.radios.between import Common
from wonderland_edge_agent.references.sources import UdpSource
from wonderland_edge_agent.settings import parse
from wonderland_edge_agent.spool.lock import ProcessLock
from wonderland_fabric_gateway.embedded.node import EmbeddedLedger, LedgerSettings
from wonderland_fabric_gateway.embedded.orderer import BatchLimits
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fira_uci.uci.config import ParameterId
from wonderland_simulator.uci_node import SR150, Air, Measurement, PtyPort, VirtualNode

SPEED = 8
"""The calibration's clock runs so much faster: half a minute takes four seconds."""
REPORTED_S = 0.016
"""After the middle of a round of four nodes; these milliseconds of the air do not run faster."""
BIAS_M = {"A1": 0.20, "A2": -0.10, "A3": 0.05, "A4": 0.12}
PLACES = {"A1": (1.6, 1.6, 1.6), "A2": (-1.6, 1.6, 0.25), "A3": (-1.6, -1.6, 0.25), "A4": (1.6, -1.6, 0.25)}
LATE_M = {"A1": 0.0, "A2": 0.6, "A3": -0.2, "A4": -0.4}
TICKS_PER_M = 63_897_600_000 / 299_792_458
ORIGIN = Origin(60.4518, 22.2666, 30.0)

pytestmark = pytest.mark.timeout(300)  # seconds of work; minutes where the machine is crowded


class Clock:
    def __init__(self) -> None:
        self.start_s = time.monotonic()
        self.epoch_ms = time.time_ns() // 1_000_000

    def __call__(self) -> int:
        return self.epoch_ms + round((time.monotonic() - self.start_s) * 1000 * SPEED)


class Person:
    """Who answers yes, and remembers what was told."""

    def __init__(self, answers=()) -> None:
        self.said: list[str] = []
        self.checks: list = []
        self.answers = list(answers)
        self.asked: list[str] = []

    def step(self, number, name, text) -> None:
        self.said.append(f"{number} {name}")

    def say(self, text) -> None:
        self.said.append(text)

    warn = say

    def confirm(self, text) -> bool:
        self.asked.append(text)
        return self.answers.pop(0) if self.answers else text.startswith("Publish")

    def show_check(self, found) -> None:
        self.checks.append(found)

    def progress(self, recorder, seconds, reach_m, problem) -> None:
        self.coverage = recorder.coverage

    def show_result(self, found) -> None:
        self.result = found


class Site:
    """A pad and a drone that is carried around it: out and back, one and a half turns in 30 s of the clock."""

    def __init__(self, directory) -> None:
        self.directory = directory
        self.clock = Clock()
        self.stand = dict(PLACES)
        self.clock_late_m: dict[str, float] | None = None
        self.rng = random.Random(4)
        self.air = Air(self.measure, stamp=self.stamp, rng=random.Random(3), jitter_ms=0)
        self.ports = {}
        for name in (*PLACES, "tag"):
            self.ports[name] = PtyPort(VirtualNode(name, self.air), directory / f"tty-{name}")
            self.ports[name].plug()
        (directory / "survey.csv").write_text(
            "anchor,x,y,z,sigma,mac\n"
            + "".join(f"{n},{x},{y},{z},0.003,{0xA001 + i:04x}\n" for i, (n, (x, y, z)) in enumerate(PLACES.items()))
        )

    def where(self, t_s: float) -> tuple[float, float, float]:
        share = (t_s - self.clock.epoch_ms / 1000) / 30
        radius = 3.0 + 6.0 * abs(math.sin(math.pi * share))
        return (radius * math.cos(3 * math.pi * share), radius * math.sin(3 * math.pi * share), 2.0)

    def measure(self, observer: str, peer: str, t_s: float) -> Measurement:
        if "tag" in (observer, peer):
            anchor = peer if observer == "tag" else observer
            place = self.where(self.clock() / 1000 + REPORTED_S * (SPEED - 1))
            away = math.dist(self.stand[anchor], place) + BIAS_M[anchor] + self.rng.gauss(0, 0.02)
        else:
            away = math.dist(self.stand[observer], self.stand[peer]) + 0.05 + self.rng.gauss(0, 0.02)
        return Measurement(round(away * 1000))

    def stamp(self, anchor: str, tag: str, t_s: float) -> int | None:
        """The counters count the clock's seconds; each is late in its own way."""
        if self.clock_late_m is None:
            return None
        place = self.where(self.clock() / 1000)
        late = self.clock_late_m[anchor] + self.rng.gauss(0, 0.02)
        return round((299_792_458.0 * t_s + math.dist(PLACES[anchor], place) + late) * TICKS_PER_M)

    def settings(self, **more) -> LiveSettings:
        pad = parse(
            {
                "pad_id": "pad-7",
                "connection": str(self.directory / "ledger" / "connection.json"),
                "spool": str(self.directory / "spool"),
                "anchors": [{"anchor_id": n, "port": str(self.directory / f"tty-{n}")} for n in PLACES],
            },
            self.directory / "pad.toml",
        )
        found = LiveSettings(
            pad=pad,
            state=self.directory / "state",
            anchors=self.directory / "survey.csv",
            origin=ORIGIN,
            tag_port=str(self.directory / "tty-tag"),
            reference_live=UdpSource(("127.0.0.1", 0)),
            seconds=30.0,
            truth_shift_s=0.0,
            check_rounds=8,
            run_interval_ms=32,
            operator=Operator(connection=pad.connection, register_as="Pad seven", operator_id="skyport"),
        )
        return replace(found, **more)

    @contextlib.asynccontextmanager
    async def surveyor(self, wizard: Wizard):
        """Sends where the drone is, as soon as somebody listens."""

        async def send() -> None:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
                while True:
                    await asyncio.sleep(0.01)
                    if wizard.reference_address is not None:
                        t_s = self.clock() / 1000
                        x, y, z = self.where(t_s)
                        out.sendto(json.dumps({"t": t_s, "x": x, "y": y, "z": z}).encode(), wizard.reference_address)
                        out.sendto(b"not a position", wizard.reference_address)

        task = asyncio.create_task(send())
        try:
            yield
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    async def commission(self, operator=None, **more):
        operator = operator or Person()
        wizard = Wizard(self.settings(**more), operator, clock=self.clock)
        async with self.surveyor(wizard):
            return await wizard.run(), operator

    def close(self) -> None:
        for port in self.ports.values():
            port.close()
        self.air.close()


@pytest.fixture
async def site(tmp_path):
    made = Site(tmp_path)
    yield made
    made.close()


@pytest.fixture
async def ledger(site):
    node = EmbeddedLedger(site.directory / "ledger", {"pol": CONTRACT}, LedgerSettings(limits=BatchLimits(time_ms=1)))
    await node.start()
    yield node
    await node.stop()


async def pad_on(ledger):
    async with ledger.connection.open_channel() as channel:
        connection = ledger.connection
        gateway = Gateway(channel, connection.identity("pad_operator"), connection.signer("pad_operator"))
        return await ProofContract(gateway.network(connection.channel), connection.chaincode).read_pad("pad-7")


async def test_a_pad_is_commissioned_from_survey_to_ledger_and_can_go_on_at_any_step(site, ledger):
    refused = Person(answers=[False])
    done, _ = await site.commission(refused)
    assert done["published"] is False
    assert refused.checks[0].agrees
    assert refused.coverage.rounds > 100
    await ledger.stop()
    with pytest.raises(PublishError, match="publish again later"):
        await site.commission()
    await ledger.start()
    # Called again it measures nothing: the nodes may even be gone.
    for port in site.ports.values():
        port.unplug()
    done, again = await site.commission()
    assert done["published"] is True
    assert again.checks == []
    pad = await pad_on(ledger)
    assert pad.status == "commissioned"
    assert pad.commissioning_sha256 == done["commissioning_sha256"]
    record = Commissioning.decode((site.directory / "state" / "commissioning.json").read_bytes())
    assert pad.commissioning == record
    for anchor in record.anchors:
        bias, sigma = bias_at(anchor, 6_000.0)
        assert bias == pytest.approx(1000 * BIAS_M[anchor.anchor_id], abs=50)  # without a table it is 50 to 200 mm off
        assert sigma < 60
    assert (record.anchors[0].mac, record.anchors[0].survey_sigma_mm) == (0xA001, 3)
    assert (site.directory / "state" / "report.html").stat().st_size > 50_000
    baseline = json.loads((site.directory / "spool" / "anchors.json").read_text())
    assert baseline["commissioning_sha256"] == done["commissioning_sha256"]
    assert len(baseline["pairs"]) == 6


async def test_nodes_of_channel_five_are_calibrated_there(site):
    for port in site.ports.values():
        profile = port.node.profile
        said = dict(profile.capabilities) | {0x0E: b"\x01"}
        five = {**profile.accepts, ParameterId.CHANNEL_NUMBER: frozenset((5,))}
        port.node.profile = replace(profile, capabilities=tuple(said.items()), accepts=five)
    _, operator = await site.commission(dry_run=True)
    record = Commissioning.decode((site.directory / "state" / "commissioning.json").read_bytes())
    assert record.nodes.channels == (5,)
    assert len(operator.checks[0].anchors) == len(PLACES)


def test_a_tag_on_another_computer_is_told_channel_and_slots():
    plan = TagPlan(macs={"A1": 1, "A2": 2, "A3": 3}, tag_mac=9, session_id=7, key=bytes(16)).among(Common(5, 10_000))
    assert plan.interval_ms >= 13 * 10
    assert "--channel 5 --slot-ms 10 " in plan.command(Path("run.key"))
    assert (plan.blinks().channel, plan.blinks().slot_duration_rstu) == (5, 12_000)


async def test_time_stamps_of_the_same_run_calibrate_the_clocks(site):
    for port in site.ports.values():
        port.node.become(SR150)
    site.clock_late_m = LATE_M
    _, operator = await site.commission(dry_run=True)
    state = site.directory / "state"
    record = Commissioning.decode((state / "commissioning.json").read_bytes())
    assert 15 <= record.timestamp_sigma_mm <= 45
    for anchor in record.anchors:
        assert anchor.clock_offset_mm == pytest.approx(1000 * LATE_M[anchor.anchor_id], abs=40)
        assert anchor.clock_sigma_mm <= 60
    assert operator.result.timed_reaches
    assert "what time stamps alone can verify" in (state / "report.html").read_text()
    assert (state / "stamps-1.csv").read_text().startswith("t,anchor,blink,ticks")


async def test_nodes_that_time_stamp_nothing_leave_the_clocks_unknown(site):
    done, operator = await site.commission(dry_run=True)
    record = Commissioning.decode((site.directory / "state" / "commissioning.json").read_bytes())
    assert record.timestamp_sigma_mm is None
    assert operator.result.clocks is None
    told = next(said for said in operator.said if "No time stamps of blinks" in said)
    assert "RANGING_ROUND_USAGE" in told  # what these boards refuse
    assert done["published"] is False


async def test_an_anchor_that_stands_elsewhere_is_named_before_anything_is_calibrated(site):
    site.stand["A3"] = (-1.2, -1.6, 0.25)
    operator = Person(answers=[False])
    with pytest.raises(SurveyError, match="disagree"):
        await site.commission(operator, dry_run=True)
    found = operator.checks[0]
    assert found.suspect.anchor_id == "A3"
    assert found.suspect.off_m == pytest.approx(0.4, abs=0.08)
    assert "go on" in operator.asked[0].lower()


async def test_without_a_reference_the_run_is_kept_until_it_comes(site, tmp_path):
    with pytest.raises(Exception, match="give --reference FILE"):
        await site.commission(reference_live=None, dry_run=True, seconds=30.0)
    track = tmp_path / "track.csv"
    start = site.clock.epoch_ms / 1000
    rows = (f"{start + i / 10},{','.join(map(str, site.where(start + i / 10)))}" for i in range(3_000))
    track.write_text("t,x,y,z\n" + "\n".join(rows) + "\n")
    done, operator = await site.commission(reference_live=None, reference_file=track, dry_run=True)
    assert done["published"] is False
    assert operator.result.fit.coverage.seconds >= 20


async def test_what_keeps_a_live_commissioning_from_beginning(site):
    lock_directory = site.directory / "spool"
    lock_directory.mkdir()
    lock = ProcessLock(lock_directory / "spool.lock")
    with pytest.raises(RadioError, match="agent seems to run"):
        await site.commission(dry_run=True)
    lock.release()
    with pytest.raises(SurveyError, match="tied to the globe"):
        await site.commission(dry_run=True, origin=None, state=site.directory / "other")
    with pytest.raises(StateError, match="no step"):
        await site.commission(redo="everything")
    (site.directory / "state" / "about.json").write_text('{"version": 1, "pad_id": "pad-8"}')
    with pytest.raises(StateError, match="pad-8"):
        await site.commission(dry_run=True)
    survey = site.directory / "survey.csv"
    survey.write_text(survey.read_text().replace("A4", "A5"))
    with pytest.raises(SurveyError, match="A4, A5"):
        await site.commission(dry_run=True, state=site.directory / "third")


async def test_the_command_goes_on_from_kept_steps(tmp_path, make_world):
    """The steps that measure are done: no node is needed any more, and nothing is sent."""
    ranges, anchors = make_world().files(tmp_path, 40.0)
    rows = [line.split(",") for line in ranges.read_text().splitlines()]
    state = tmp_path / "state"
    state.mkdir()
    (state / "run-1.csv").write_text("\n".join(",".join(row[:3]) for row in rows) + "\n")
    seen = {row[0]: row[3:] for row in rows[1:]}
    (state / "reference-1.csv").write_text("t,x,y,z\n" + "".join(f"{t},{','.join(p)}\n" for t, p in seen.items()))
    (state / "run.json").write_text("{}")
    (state / "check.json").write_text(
        '{"rows": [{"anchor_id": "A1", "off_m": 0.01, "sigma_m": 0.02, "suspect": false}]}'
    )
    config = tmp_path / "pad.toml"
    config.write_text(
        'pad_id = "pad-7"\nconnection = "ledger/connection.json"\nspool = "spool"\n'
        + "".join(f'[[anchors]]\nanchor_id = "{n}"\nport = "{tmp_path}/tty-{n}"\n' for n in PLACES)
    )
    arguments = ["--config", config, "--state", state, "--anchors", anchors, "--origin", "60.45,22.27,30", "--json"]
    process = await asyncio.create_subprocess_exec(
        Path(sys.executable).with_name("wonderland"), "pad", "commission", *map(str, arguments), "--dry-run",
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    out, told = await process.communicate()
    assert process.returncode == 0, told.decode()
    assert json.loads(out)["published"] is False
    assert "5. Publish" in told.decode()
    assert "At 5 m: 90 % of honest drones within" in told.decode()
    assert "checked by the anchors themselves" in (state / "report.html").read_text()


def test_rounds_that_do_not_fit_into_the_interval_are_refused_before_any_node_is_asked():
    macs = {f"A{index}": 0xA001 + index for index in range(8)}
    with pytest.raises(RadioError, match="8 nodes and a blink take 46 ms, and the interval is 30 ms"):
        TagPlan(macs=macs, tag_mac=0xD001, session_id=1, key=bytes(16), interval_ms=30)
