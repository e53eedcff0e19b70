"""Evidence of a channel whose blocks four orderers sign by their numbers (BFT): a quorum of three, and no fewer."""

from __future__ import annotations

import pytest
from kit.evidence import exhibit, with_block
from kit.scenario_world import FabricPlace

from wonderland_evidence.case import Case
from wonderland_evidence.errors import UnreadableError
from wonderland_fabric_network import binaries
from wonderland_fabric_network.errors import BinaryError

pytestmark = [pytest.mark.fabric, pytest.mark.timeout(300)]


@pytest.fixture(scope="module")
def ordered(tmp_path_factory, aside):
    try:
        binaries.find_binaries()
    except BinaryError as error:
        pytest.skip(f"Fabric's servers are needed: {error}")
    place = FabricPlace(tmp_path_factory.mktemp("bft"), "bft")
    aside(place.start)
    try:
        yield aside(exhibit, place, tmp_path_factory.mktemp("bft-evidence"))
    finally:
        aside(place.stop)


def test_a_quorum_signed_every_block(ordered):
    report = ordered.report()
    assert report.failed is None, report.failed
    assert report.is_whole
    assert report.findings[4].text.startswith("BFT: ")
    assert {each.by_number for block in ordered.bundle.blocks for each in block.signatures} == {True}


def test_fewer_than_a_quorum_are_too_few(ordered):
    number = Case(ordered.bundle).of_session("SubmitProof").block
    block = next(each for each in ordered.bundle.blocks if each.number == number)
    assert ordered.failing(with_block(ordered.bundle, number, signatures=block.signatures[:3])) is None
    step, text = ordered.failing(with_block(ordered.bundle, number, signatures=block.signatures[:2]))
    assert (step, "3 are needed" in text) == (5, True)
    twice = (block.signatures[0], block.signatures[1], block.signatures[0])
    with pytest.raises(UnreadableError, match="stands there twice"):
        ordered.failing(with_block(ordered.bundle, number, signatures=twice))


@pytest.mark.browser
def test_the_page_counts_the_same(shown_in, ordered):
    assert shown_in(ordered.data, ordered.trust)[0] == ["holds"] * 11 + ["not_checked"] * 2
    number = Case(ordered.bundle).of_session("SubmitProof").block
    block = next(each for each in ordered.bundle.blocks if each.number == number)
    few = with_block(ordered.bundle, number, signatures=block.signatures[:2])
    assert shown_in(few.encode(), ordered.trust)[0].index("fails") == 4
    twice = with_block(ordered.bundle, number, signatures=(*block.signatures[:2], block.signatures[0]))
    assert "twice" in shown_in(twice.encode(), ordered.trust)[1]
