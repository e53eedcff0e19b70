"""A contract that does not end is ended, and the ledger goes on."""

import logging

import pytest

from wonderland_fabric_gateway.embedded.watchdog import ContractOvertimeError, Watchdog
from wonderland_fabric_gateway.gateway import EndorseError, EvaluateError


@pytest.fixture
def watchdog():
    watchdog = Watchdog(limit_s=0.01)
    yield watchdog
    watchdog.close()


@pytest.mark.parametrize("how", ["", "stubborn"])
async def test_a_contract_that_loops_is_ended_and_others_go_on(tmp_path, open_world, caplog, how):
    async with open_world(tmp_path / "ledger", execute_limit_s=0.3) as world:
        contract = world.contract()
        with pytest.raises(EndorseError, match=r"chaincode response 500, the contract failed \(reference"):
            await contract.submit("loop", how)
        with pytest.raises(EvaluateError, match=r"the contract failed \(reference"):
            await contract.evaluate("loop", how)
        await contract.submit("put", "k", "v")
        assert await contract.evaluate("get", "k") == b"v"
        assert world.chain.height == 2
    said = [each for each in caplog.records if each.levelno == logging.CRITICAL]
    assert len(said) == 2
    assert "takes longer than 0.3 s and is ended" in said[0].getMessage()


def test_what_ends_in_time_is_left_alone(watchdog):
    for _ in range(3):
        with watchdog.watch("quick"):
            pass
        watchdog._closed.wait(0.05)  # the time of several looks


def test_an_exception_that_is_due_never_comes_out_elsewhere(watchdog):
    """Work that takes about as long as the limit: it ends, or is ended; afterwards nothing is raised any more."""
    ended = 0
    for count in range(60):
        try:
            with watchdog.watch("about as long"):
                for _ in range(5_000 * (count % 12)):
                    pass
        except ContractOvertimeError:
            ended += 1
        for _ in range(20_000):  # here it must not
            pass
    assert ended < 60  # not what took no time at all


def test_work_that_is_too_long_is_ended(watchdog):
    with pytest.raises(ContractOvertimeError), watchdog.watch("for ever"):
        while True:
            pass
