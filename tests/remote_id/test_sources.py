"""Every receiver that a pad can have, each against its real counterpart: sockets, pseudo-terminals, a broker, a bus."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
import tty
from pathlib import Path

import aiomqtt
import pytest
from kit.mqtt_broker import Broker

from wonderland_edge_agent.receiver import Heard, ReceiverError, RemoteIdReceiver
from wonderland_edge_agent.receiver.configured import sources_of
from wonderland_edge_agent.receiver.settings import MqttSettings, ReceiverSettings
from wonderland_edge_agent.receiver.sources.replay import ReplaySource
from wonderland_edge_agent.receiver.sources.serial import SerialLines, SerialMavlink
from wonderland_edge_agent.receiver.sources.wifi_monitor import WifiMonitorSource, open_monitor
from wonderland_remote_id import BasicId, Location, Pack, encode, to_json
from wonderland_remote_id.framings import ble, captures, mavlink, wifi

SERIAL = "1581F5FKD229400A1234"
ADDRESS = "02:00:00:00:00:01"


def pack(lat_e7: int = 601_700_000) -> bytes:
    return encode(Pack(messages=(BasicId(uas_id=SERIAL), Location(lat_e7=lat_e7, lon_e7=249_400_000))))


async def until(condition, timeout_s: float = 30) -> None:
    async with asyncio.timeout(timeout_s):
        while not condition():
            await asyncio.sleep(0.005)


@contextlib.asynccontextmanager
async def listening(*sources, **options):
    heard: list[Heard] = []
    receiver = RemoteIdReceiver(sources=sources, on_heard=heard.append, **options)
    await receiver.start()
    try:
        yield receiver, heard
    finally:
        await receiver.close()


class Terminal:
    """A pseudo-terminal in place of a serial device; ``write`` is the device's side."""

    def __init__(self) -> None:
        self.master, self._fd = os.openpty()
        os.set_blocking(self._fd, False)
        tty.setraw(self._fd)

    def __call__(self) -> Terminal:
        return self

    def fileno(self) -> int:
        return self._fd

    def close(self) -> None:
        os.close(self._fd)
        os.close(self.master)

    def write(self, data: bytes) -> None:
        os.write(self.master, data)


async def test_datagrams_of_every_kind() -> None:
    async with listening(listen=("127.0.0.1", 0)) as (receiver, heard):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            document = {"messages": [to_json(Pack(messages=(BasicId(uas_id=SERIAL), Location(lat_e7=3, lon_e7=4))))]}
            for data in (
                pack(1_000),
                mavlink.build_frame(pack(2_000), address=ADDRESS),
                json.dumps(document).encode(),
                b"{nothing",
                b"\x92" + bytes(24),
                b"",
            ):
                sender.sendto(data, receiver.address)
            await until(lambda: len(heard) == 3 and receiver.counts.bad >= 3)
    assert [(one.track.lat_e7, one.track.transport) for one in heard] == [
        (1_000, "udp"),
        (2_000, "mavlink"),
        (3, "json"),
    ]


async def test_a_mavlink_bridge_on_a_serial_line() -> None:
    device = Terminal()
    async with listening(SerialMavlink("mavlink:0", device)) as (_, heard):
        stream = mavlink.build(BasicId(uas_id=SERIAL), address=ADDRESS) + b"\xfd\x01\x02noise"
        stream += mavlink.build(Location(lat_e7=601_700_000, lon_e7=1), address=ADDRESS)
        for at in range(0, len(stream), 7):
            device.write(stream[at : at + 7])
        await until(lambda: len(heard) == 1)
    assert (heard[0].track.uav_id, heard[0].track.transport) == (SERIAL, "mavlink")


async def test_lines_of_json_on_a_serial_line() -> None:
    device = Terminal()
    async with listening(SerialLines("serial:0", device)) as (receiver, heard):
        document = {"Basic ID": {"id": SERIAL, "id_type": "Serial", "MAC": ADDRESS, "RSSI": -70}}
        document["Location/Vector Message"] = {"latitude": 60.17, "longitude": 24.94}
        device.write(json.dumps(document).encode() + b"\r\n{\n[1]\n")
        await until(lambda: len(heard) == 1 and receiver.counts.bad == 2)
        device.write(b"{")
        for _ in range(20):  # one endless line is one bad frame; a terminal holds 4 KiB
            device.write(b" " * 1_000)
            await asyncio.sleep(0.01)
        await until(lambda: receiver.counts.bad == 3)
        device.write(b"\n" + json.dumps(document).replace("60.17", "60.18").encode() + b"\n")
        await until(lambda: len(heard) == 2)
    assert heard[0].track.rssi == -70


async def test_a_capture_in_place_of_a_receiver(tmp_path: Path) -> None:
    file = tmp_path / "heard.pcap"
    packets = [wifi.beacon(pack(step), step, ADDRESS) for step in range(1, 6)]
    packets.insert(2, packets[0][:-9])
    records = [captures.pcap_record(packet, 1_800_000_000_000 + number) for number, packet in enumerate(packets)]
    file.write_bytes(captures.pcap_header(captures.WIFI) + b"".join(records))
    source = ReplaySource(file, speed=1.0)
    async with listening(source) as (receiver, heard):
        async with asyncio.timeout(30):
            await source.finished.wait()
        assert [one.track.lat_e7 for one in heard] == [1, 2, 3, 4, 5]
        assert receiver.counts.bad == 1
    broken = tmp_path / "broken.pcap"
    broken.write_bytes(file.read_bytes()[:-3])
    source = ReplaySource(broken, speed=0)
    async with listening(source) as (_, heard):
        async with asyncio.timeout(30):
            await source.finished.wait()
        assert len(heard) == 4
    with pytest.raises(ReceiverError, match="replay"):
        async with listening(ReplaySource(tmp_path / "absent")):
            pass


async def test_wifi_in_monitor_mode() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    ours.setblocking(False)
    again = [ours]

    def opener(interface: str) -> socket.socket:
        assert interface == "wlan1"
        if not again:
            raise ReceiverError("gone")
        return again.pop()

    with theirs:
        async with listening(WifiMonitorSource("wlan1", opener)) as (receiver, heard):
            theirs.send(wifi.radiotap(wifi.nan_action(pack(), 7, ADDRESS), -66))
            theirs.send(wifi.radiotap(b"\x80" + bytes(60), -40))
            theirs.send(b"\1\2")
            theirs.send(wifi.radiotap(wifi.beacon(pack(5), 8, ADDRESS), -67))
            await until(lambda: len(heard) == 2)
    assert [(one.track.transport, one.track.rssi) for one in heard] == [("wifi-nan", -66), ("wifi-beacon", -67)]
    assert receiver.counts.bad == 1


async def test_wifi_that_is_no_monitor() -> None:
    with pytest.raises(ReceiverError, match=r"monitor mode|CAP_NET_RAW"):
        open_monitor("lo")
    with pytest.raises(ReceiverError, match=r"remote_id\.wifi"):
        open_monitor("no-such-if")


async def publish(broker: Broker, topic: str, *payloads: bytes) -> None:
    protocol = aiomqtt.ProtocolVersion.V5
    async with aiomqtt.Client("127.0.0.1", broker.port, protocol=protocol, identifier="receiver") as client:
        for payload in payloads:
            await client.publish(topic, payload)


async def test_a_receiver_that_publishes_over_mqtt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wonderland_edge_agent.receiver.sources.mqtt.AGAIN_S", 0.05)
    broker = Broker(tmp_path)
    [source] = sources_of(
        ReceiverSettings(mqtt=MqttSettings(host="127.0.0.1", port=broker.port, topics=("scout/+/drones",)))
    )

    def document(lat: float) -> bytes:
        odid = {"BasicID": [{"UASID": SERIAL, "IDType": 1}], "Location": {"Latitude": lat, "Longitude": 24.94}}
        return json.dumps({"sn": "S1", "rssi": -71, "odid": odid}).encode()

    try:
        async with listening(source) as (receiver, heard):
            await asyncio.sleep(0)  # the broker is not there yet: the source has to wait for it
            await broker.start()
            await asyncio.wait_for(source.connected.wait(), 60)
            await publish(broker, "scout/one/drones", document(60.17), b"{", b"\xff", document(60.18))
            await publish(broker, "scout/one/heartbeat", document(60.99))
            await until(lambda: len(heard) == 2 and receiver.counts.bad == 2, 60)
            broker.stop()
            await until(lambda: not source.connected.is_set(), 60)
            await broker.start()
            await asyncio.wait_for(source.connected.wait(), 60)
            await publish(broker, "scout/two/drones", document(60.19))
            await until(lambda: len(heard) == 3, 60)
    finally:
        broker.stop()
    assert [(one.track.lat_e7, one.track.rssi) for one in heard] == [
        (601_700_000, -71),
        (601_800_000, -71),
        (601_900_000, -71),
    ]


async def test_mqtt_settings_that_cannot_be_read(tmp_path: Path) -> None:
    settings = MqttSettings(host="127.0.0.1", topics=("x",), username="pad", password_file=tmp_path / "absent")
    with pytest.raises(ReceiverError, match="absent"):
        async with listening(*sources_of(ReceiverSettings(mqtt=settings))):
            pass


BUS = """<!DOCTYPE busconfig PUBLIC "-//freedesktop//DTD D-Bus Bus Configuration 1.0//EN"
 "http://www.freedesktop.org/standards/dbus/1.0/busconfig.dtd">
<busconfig><type>session</type><listen>unix:path={path}</listen><auth>EXTERNAL</auth>
<policy context="default"><allow send_destination="*" eavesdrop="true"/><allow eavesdrop="true"/><allow own="*"/>
</policy></busconfig>"""


@contextlib.asynccontextmanager
async def bus(directory: Path):
    """A D-Bus daemon of its own, and a BlueZ on it that speaks as the real one does."""
    daemon = shutil.which("dbus-daemon")
    if daemon is None:
        pytest.skip("needs dbus-daemon")
    pytest.importorskip("dbus_fast")
    path = directory / "bus"
    config = directory / "bus.conf"
    config.write_text(BUS.format(path=path))
    process = subprocess.Popen([daemon, f"--config-file={config}", "--nofork"], stderr=subprocess.DEVNULL)
    try:

        def answers() -> bool:
            with socket.socket(socket.AF_UNIX) as probe:
                return probe.connect_ex(str(path)) == 0

        await until(answers)
        yield f"unix:path={path}"
    finally:
        process.kill()
        process.wait()


async def test_bluetooth_by_bluez(tmp_path: Path) -> None:
    async with bus(tmp_path) as address:
        from dbus_fast import Message, MessageType, Variant
        from dbus_fast.aio import MessageBus

        from wonderland_edge_agent.receiver.sources.bluez import BluezSource

        calls: list[tuple[str, list]] = []
        peer = await MessageBus(bus_address=address).connect()

        def answer(message: Message) -> Message | None:
            if message.message_type is MessageType.METHOD_CALL and message.path.startswith("/org/bluez"):
                calls.append((message.member, message.body))
                return Message.new_method_return(message)
            return None

        peer.add_message_handler(answer)
        await peer.request_name("org.bluez")
        source = BluezSource("hci0", address)
        async with listening(source) as (receiver, heard):
            assert [member for member, _ in calls] == ["Set", "SetDiscoveryFilter", "StartDiscovery"]
            device = "/org/bluez/hci0/dev_C0_FF_EE_00_00_01"

            async def advertise(frame: bytes, counter: int, *, added: bool = False) -> None:
                data = {ble.SERVICE_UUID: Variant("ay", ble.service_data(frame, counter))}
                properties = {"ServiceData": Variant("a{sv}", data), "RSSI": Variant("n", -77)}
                if added:
                    interfaces = {"org.bluez.Device1": properties}
                    signal = (
                        "/",
                        "org.freedesktop.DBus.ObjectManager",
                        "InterfacesAdded",
                        "oa{sa{sv}}",
                        [device, interfaces],
                    )
                else:
                    body = ["org.bluez.Device1", properties, []]
                    signal = (device, "org.freedesktop.DBus.Properties", "PropertiesChanged", "sa{sv}as", body)
                path, interface, member, signature, body = signal
                await peer.send(Message.new_signal(path, interface, member, signature, body))

            await advertise(encode(BasicId(uas_id=SERIAL)), 1, added=True)
            await advertise(encode(Location(lat_e7=601_700_000, lon_e7=1)), 2)
            await advertise(b"\x12", 3)
            await advertise(pack(601_700_500), 4)
            await until(lambda: len(heard) == 2 and receiver.counts.bad == 1)
        peer.disconnect()
        await peer.wait_for_disconnect()
    assert [(one.track.transport, one.track.rssi) for one in heard] == [("ble4", -77), ("ble5", -77)]


async def test_bluetooth_that_is_not_there(tmp_path: Path) -> None:
    pytest.importorskip("dbus_fast")
    from wonderland_edge_agent.receiver.sources.bluez import BluezSource

    with pytest.raises(ReceiverError, match="D-Bus"):
        async with listening(BluezSource("hci0", f"unix:path={tmp_path / 'nothing'}")):
            pass
    async with bus(tmp_path) as address:
        with pytest.raises(ReceiverError, match="bluetoothd"):
            async with listening(BluezSource("hci0", address)):
                pass


def test_a_pad_loads_only_what_it_is_told_to() -> None:
    code = (
        "import sys; from wonderland_edge_agent.receiver.configured import sources_of; "
        "from wonderland_edge_agent.receiver.settings import ReceiverSettings; "
        "import wonderland_edge_agent.receiver; sources_of(ReceiverSettings()); "
        "print([name for name in sys.modules if name.split('.')[0] in {'aiomqtt', 'paho', 'dbus_fast', 'Crypto'} "
        "or name.startswith(('wonderland_remote_id.framings.', 'wonderland_edge_agent.receiver.sources.'))])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == "[]"
