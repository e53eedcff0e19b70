"""A session on a ledger, its evidence, and what may be done to a bundle's bytes."""

from __future__ import annotations

import asyncio
import json
from dataclasses import dataclass, replace

from click.testing import CliRunner

from kit.forgers import endorsed_by_nobody, one_endorsement_more, submitted_changed
from kit.scenario_world import Site, people_at
from wonderland.proofs import encoding
from wonderland_evidence.bundle import Bundle
from wonderland_evidence.commands import evidence
from wonderland_evidence.trust import Pins
from wonderland_evidence.verify import verify


@dataclass(frozen=True, repr=False)
class Exhibit:
    """The evidence of one session, and what a verifier pins."""

    kind: str
    data: bytes
    trust: bytes
    session_id: str
    place: object

    @property
    def bundle(self):
        return Bundle.decode(self.data)

    @property
    def pins(self):
        return Pins.decode(self.trust)

    def report(self, data=None):
        return verify(self.data if data is None else data, self.pins)

    def failing(self, bundle):
        """Number and text of the step that a changed bundle fails; None where all hold."""
        finding = self.report(bundle.encode()).failed
        return None if finding is None else (finding.number, finding.text)


def run(*arguments):
    """A command of ``wonderland evidence``."""
    return CliRunner().invoke(evidence, list(map(str, arguments)))


async def _session(place, tag, *, calibrated=False):
    async with people_at(place) as people:
        site = await Site(people, tag, "PadMSP").ready()
        await people.enrol("uav", f"lost-{tag}")
        await place.revoke(f"lost-{tag}")  # so that the channel has a second configuration
        valid = {"valid_from_ms": people.now_ms - 60_000, "valid_until_ms": people.now_ms + 10**10}
        anew = site.scene().commissioning(**valid, installation_sigma_mm=6)
        await site.operator.submit("CommissionPad", pad_id=site.pad_id, commissioning=anew)
        policy = {"buffer_mm": 1_000, "min_request_gap_ms": 1}
        await site.set_policy(policy, "land")
        await site.operator.submit("UpdatePad", pad_id=site.pad_id, note="swept")
        if calibrated:
            asked = await site.request("k1")
            await site.judge(asked)
            here = {"uav_id": site.uav_id, "pad_id": site.pad_id, "offset_mm": 40}
            measured = site.scene().calibration(asked["session_id"], **here, valid_until_ms=people.now_ms + 10**9)
            await site.operator.submit("CalibrateUav", measured)
        # The drone's owner would like the evidence to be of no use: two endorsements more, that hold for nobody.
        spoilt = (one_endorsement_more, endorsed_by_nobody)
        done, session = await submitted_changed(site.uav, spoilt, "RequestProof", site.wish())
        await site.judge(session)
        await site.uav.submit("CompleteInteraction", session_id=done.tx_id, result="done")
        await site.offer(1)  # a block after the session's
    return done.tx_id


async def played(place, tag, story):
    """The id of one more session: its drone asks, and ``story(site, session)`` goes on."""
    async with people_at(place) as people:
        site = await Site(people, tag, "PadMSP").ready()
        session = await site.request()
        await story(site, session)
    return session["session_id"]


def exhibit(place, directory, tag="e1", *, calibrated=False):
    """A session on a ledger that runs, exported by the command. ``calibrated``: its drone was, at the pad."""
    session_id = asyncio.run(_session(place, tag, calibrated=calibrated))
    files = directory / "evidence.json", directory / "trust.json"
    connection = place.connection_file
    for arguments in (
        ("export", "--connection", connection, "--session", session_id, "--out", files[0]),
        ("trust", "--connection", connection, "--out", files[1]),
    ):
        result = run(*arguments)
        assert result.exit_code == 0, result.output
    return Exhibit(place.kind, files[0].read_bytes(), files[1].read_bytes(), session_id, place)


def with_block(bundle, number, **change):
    """The bundle with one block changed."""
    blocks = tuple(replace(each, **change) if each.number == number else each for each in bundle.blocks)
    return replace(bundle, blocks=blocks)


def patched(data, operations):
    """A bundle after a JSON patch (RFC 6902: replace, copy, remove), in canonical encoding."""
    document = json.loads(data)

    def found(path):
        *way, last = [int(each) if each.isdigit() else each for each in path.split("/")[1:]]
        inside = document
        for each in way:
            inside = inside[each]
        return inside, last

    for each in operations:
        container, key = found(each["path"])
        if each["op"] == "remove":
            del container[key]
        elif each["op"] == "copy":
            there, name = found(each["from"])
            container[key] = there[name]
        else:
            container[key] = each["value"]
    return encoding.encode(document)


def lines(result):
    """The objects that ``--json`` printed."""
    return [json.loads(line) for line in result.output.splitlines()]
