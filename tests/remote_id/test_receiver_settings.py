"""``[remote_id]`` of pad.toml: every receiver configured, every mistake named."""

from __future__ import annotations

from pathlib import Path

import pytest

from wonderland.toml_settings import SettingsError
from wonderland_edge_agent.receiver import ReceiverError
from wonderland_edge_agent.receiver.configured import sources_of
from wonderland_edge_agent.receiver.settings import ReceiverSettings, registry_of
from wonderland_edge_agent.settings import parse

FILE = Path("/pads/pad.toml")
PAD = {
    "pad_id": "pad-1",
    "connection": "connection.json",
    "identity": "pad",
    "spool": "spool",
    "anchors": [{"anchor_id": f"A{number}", "port": f"/dev/ttyACM{number}"} for number in range(4)],
}


def receivers(**remote_id) -> ReceiverSettings:
    return parse(PAD | {"remote_id": remote_id}, FILE).remote_id


def test_nothing_by_default() -> None:
    assert receivers() == ReceiverSettings()
    assert sources_of(receivers()) == []
    assert registry_of(receivers()) is None


def test_everything() -> None:
    settings = receivers(
        listen="127.0.0.1:0",
        serial=["/dev/ttyUSB0"],
        mavlink=["/dev/ttyUSB1", "/dev/ttyUSB2"],
        bluetooth="hci0",
        wifi="wlan1",
        replay="heard.pcap",
        replay_speed_percent=0,
        drip="registries.json",
        mqtt={
            "host": "broker.example",
            "topics": ["scout/#"],
            "username": "pad",
            "password_file": "secret",
            "tls_ca": "ca.pem",
        },
    )
    assert settings.mqtt is not None
    assert (settings.mqtt.broker_port, settings.mqtt.password_file) == (8883, Path("/pads/secret"))
    assert (settings.replay, settings.drip) == (Path("/pads/heard.pcap"), Path("/pads/registries.json"))
    names = [type(source).__name__ for source in sources_of(settings)]
    assert names == ["SerialMavlink", "SerialMavlink", "MqttSource", "BluezSource", "WifiMonitorSource", "ReplaySource"]
    with pytest.raises(ReceiverError, match=r"remote_id\.drip: /pads/registries\.json"):
        registry_of(settings)


@pytest.mark.parametrize(
    ("remote_id", "says"),
    [
        ({"blutooth": "hci0"}, r"remote_id\.blutooth is unknown"),
        ({"mavlink": "/dev/ttyUSB0"}, r"remote_id\.mavlink is '/dev/ttyUSB0', expected a list"),
        ({"wifi": ""}, r"remote_id\.wifi is '', expected"),
        ({"replay_speed_percent": -1}, r"replay_speed_percent is -1"),
        ({"mqtt": {"topics": ["x"]}}, r"remote_id\.mqtt\.host is missing"),
        ({"mqtt": {"host": "b"}}, r"remote_id\.mqtt\.topics is missing"),
        ({"mqtt": {"host": "b", "topics": ["x"], "port": 0}}, r"remote_id\.mqtt\.port is 0"),
        ({"mqtt": {"host": "b", "topics": ["x"], "qos": 1}}, r"remote_id\.mqtt\.qos is unknown"),
        ({"mqtt": {"host": "b", "topics": ["x"], "password_file": "p"}}, r"username is missing"),
        ({"mqtt": {"host": "b", "topics": ["x"], "username": "u", "password_file": "p"}}, r"tls_ca is missing"),
    ],
)
def test_mistakes(remote_id, says) -> None:
    with pytest.raises(SettingsError, match=says):
        receivers(**remote_id)


def test_a_password_may_stay_on_this_machine() -> None:
    mqtt = {"host": "127.0.0.1", "topics": ["x"], "username": "u", "password_file": "p"}
    assert receivers(mqtt=mqtt).mqtt is not None
