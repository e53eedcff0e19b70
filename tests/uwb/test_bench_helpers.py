"""Names for boards, what their makers' parameters do, and what radio law says."""

import asyncio
import json
import random
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from wonderland.toml_settings import FieldError
from wonderland.uwb.agreed import ability_of
from wonderland.uwb.commands import uwb
from wonderland.uwb.regions import REGIONS
from wonderland_edge_agent.radios import AnchorPort
from wonderland_edge_agent.settings import AnchorSetting
from wonderland_fira_uci.errors import NodeUnavailableError, RangingPlanError
from wonderland_fira_uci.node import monotonic_ms
from wonderland_fira_uci.uci.capabilities import Capabilities
from wonderland_fira_uci.uci.session import Core
from wonderland_fira_uci.uci.status import Status
from wonderland_simulator.uci_node import Air, Measurement, PtyPort, VirtualNode


def board(device, serial_number="SN1", location="1-1.2", vid=0x1366, pid=0x0105):
    return SimpleNamespace(device=device, vid=vid, pid=pid, serial_number=serial_number, location=location)


@pytest.fixture
def boards(monkeypatch):
    there = []
    monkeypatch.setattr("wonderland.uwb.udev_command.list_ports.comports", lambda include_links=False: there)
    return there


def run(*words):
    return CliRunner().invoke(uwb, words)


def test_a_board_is_told_by_its_serial_number(boards):
    boards += [board("/dev/ttyACM0"), board("/dev/ttyACM1", "SN2", "1-1.3")]
    rule = run("udev", "--port", "/dev/ttyACM1", "--name", "A2").output.strip()
    assert rule == (
        'SUBSYSTEM=="tty", ATTRS{idVendor}=="1366", ATTRS{idProduct}=="0105", ATTRS{serial}=="SN2", '
        'SYMLINK+="wonderland/A2", GROUP="dialout", MODE="0660"'
    )


@pytest.mark.parametrize("serial_number", [None, "0001"])
def test_boards_without_a_number_of_their_own_are_told_by_their_place(boards, serial_number):
    boards += [board("/dev/ttyUSB0", serial_number, "1-1.2:1.0"), board("/dev/ttyUSB1", serial_number, "1-1.3:1.0")]
    assert 'KERNELS=="1-1.3"' in run("udev", "--port", "/dev/ttyUSB1", "--name", "A2").output


def test_ports_that_are_not_there_or_not_on_usb_are_named(boards):
    boards.append(board("/dev/ttyS0", None, None, None, None))
    assert "there are: /dev/ttyS0" in run("udev", "--port", "/dev/ttyACM9", "--name", "A1").output
    assert "hangs on no USB port" in run("udev", "--port", "/dev/ttyS0", "--name", "A1").output
    assert "letters, digits" in run("udev", "--port", "/dev/ttyS0", "--name", "a b").output


@pytest.mark.parametrize("region", REGIONS, ids=lambda region: region.code)
def test_every_region_says_its_channels_and_where_it_stands(region):
    said = run("law", region.code).output
    assert f"channels {', '.join(map(str, region.channels))}" in said
    assert all(each.source in said for each in region.statements)
    document = json.loads(run("law", region.code, "--json").output)
    assert document["channels"] == list(region.channels)


def test_channels_are_those_of_the_region():
    node = Capabilities(channels=(5, 9))
    assert ability_of(node, region="JP").channels == (9,)
    with pytest.raises(RangingPlanError, match="may be used in JP"):
        ability_of(Capabilities(channels=(5,)), region="JP")


class Given:
    """A virtual node that takes its maker's parameters, or refuses them."""

    def __init__(self, node, status=Status.OK):
        self.seen, self._core, self._answer = [], node._core, node._answer
        self.status = status
        node._core = self

    def __call__(self, command):
        if command.opcode == Core.SET_CONFIG:
            self.seen.append(command.payload.hex())
            self._answer(command, self.status)
        else:
            self._core(command)


@pytest.mark.parametrize("status", [Status.OK, Status.INVALID_PARAMETER])
async def test_a_node_is_given_its_makers_parameters_after_each_reset(tmp_path, status):
    node = VirtualNode("here", Air(lambda *_: Measurement(4_320), rng=random.Random(1)))
    given, port = Given(node, status), PtyPort(node, tmp_path / "here")
    port.plug()
    anchor = AnchorSetting(anchor_id="A1", port=str(port.path), device_config={"e301": "4a40", "01": "ff"})
    try:
        async with AnchorPort.of(anchor).node(monotonic_ms) as uwb_node:
            if status is Status.OK:
                await uwb_node.wait_ready()
                port.unplug()
                port.plug()
                async with asyncio.timeout(10):
                    while len(given.seen) < 2:
                        await asyncio.sleep(0.02)
            else:
                with pytest.raises(NodeUnavailableError, match=r"device_config\) was answered by INVALID_PARAMETER"):
                    await uwb_node.wait_ready(1.0)
    finally:
        port.close()
    assert given.seen[0] == "02" + "e301024a40" + "0101ff"


@pytest.mark.parametrize(("given", "said"), [({"e3": "4"}, "hexadecimal"), ({"e30102": "00"}, "1 or 2 octets")])
def test_parameters_that_no_node_takes_are_refused_with_their_field(given, said):
    with pytest.raises(FieldError, match=said):
        AnchorSetting(anchor_id="A1", port="/dev/ttyACM0", device_config=given)
