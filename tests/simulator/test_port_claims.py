"""Ports that a stage chooses stay its own until its programs listen there."""

from __future__ import annotations

import socket

import pytest

from wonderland_fabric_network.ports import FREE_RANGE
from wonderland_simulator.stage import PortClaims, ProcessError, processes


@pytest.fixture
def claims():
    made = []

    def new():
        made.append(PortClaims())
        return made[-1]

    yield new
    for each in made:
        each.close()


@pytest.fixture
def few(monkeypatch):
    """Only forty ports to choose from, of which this test has none in use."""
    first = next(
        base
        for base in range(FREE_RANGE[0], FREE_RANGE[1], 40)
        if all(_free(base + offset, kind) for offset in range(40) for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM))
    )
    monkeypatch.setattr(processes, "FREE_RANGE", (first, first + 40))
    return range(first, first + 40)


def _free(port, kind):
    with socket.socket(socket.AF_INET, kind) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def test_two_that_choose_at_the_same_time_share_no_port(claims, few):
    first, second = claims().claim(20), claims().claim(20)
    assert sorted(first + second) == list(few)
    with pytest.raises(ProcessError, match="no 1 free UDP ports"):
        claims().claim(1)


def test_what_is_claimed_can_be_listened_on_by_whom_it_is_for(claims):
    for port in claims().claim(16):
        assert FREE_RANGE[0] <= port < FREE_RANGE[1]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
            listener.bind(("127.0.0.1", port))


def test_a_port_on_which_somebody_receives_is_not_chosen(claims, few):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as somebody:
        somebody.bind(("127.0.0.1", few[7]))
        with pytest.raises(ProcessError):
            claims().claim(40)


def test_closed_claims_are_free_again(claims, few):
    first = claims()
    first.claim(20)
    first.close()
    assert len(claims().claim(20)) == 20
