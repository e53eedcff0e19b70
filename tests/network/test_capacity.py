"""What a proof costs, counted in blocks."""

import json

import pytest
from click.testing import CliRunner

from wonderland_fabric_gateway.capacity import Census, Share
from wonderland_fabric_network.commands import network as commands


def _census(**functions):
    census = Census(blocks=10, octets=120_000, transactions=sum(count for count, _ in functions.values()))
    for name, (count, octets) in functions.items():
        census.functions[name] = Share(count, octets)
    return census


def test_a_proof_is_its_three_transactions_and_its_part_of_the_prekeys():
    census = _census(
        RequestProof=(10, 50_000), SubmitProof=(10, 40_000), CompleteInteraction=(5, 10_000), PublishPrekeys=(1, 8_000)
    )
    census.state = {"\0session\x001\0": 700, "\0verdict\x001\0": 1_300, "\0pad\0x\0": 9_000}
    proof = census.proof()
    assert proof.state == pytest.approx(200)
    assert proof.transactions == pytest.approx(1 + 1 + 0.5 + 0.1)
    assert proof.octets == pytest.approx(5_000 + 4_000 + 0.5 * 2_000 + 0.1 * 8_000)
    assert proof.overhead == pytest.approx((120_000 - 108_000) / 26 * 2.6)
    assert proof.as_json()["gb_per_million"] == pytest.approx(round((proof.octets + proof.overhead) / 1000, 2))


def test_without_a_proof_there_is_no_figure():
    assert _census(RegisterPad=(3, 9_000)).proof() is None
    assert Census().as_json()["proof"] is None


@pytest.mark.fabric
@pytest.mark.timeout(120)
def test_the_command_counts_a_real_channel(running):
    answer = CliRunner().invoke(commands, ["capacity", "--json", "--dir", str(running.network.directory.path)])
    assert answer.exit_code == 0, answer.output
    found = json.loads(answer.output)
    assert found["blocks"] >= 3
    assert found["functions"]["CommitChaincodeDefinition"]["count"] >= 1
    assert found["bytes"] > sum(each["count"] * each["mean_bytes"] for each in found["functions"].values())
    assert found["disk_bytes"]["PadMSP.peer0"] > found["bytes"]
    text = CliRunner().invoke(commands, ["capacity", "--dir", str(running.network.directory.path)])
    assert "There is no proof among them yet." in text.output
