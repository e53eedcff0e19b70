"""Bluetooth by BlueZ: advertisements with the service data of Remote ID, over D-Bus.

BlueZ does the scanning (Bluetooth 4 and 5; the coded PHY where the adapter has it) and tells new service data as
changed properties of a device. It does not tell each repetition, which does no harm.
"""

from __future__ import annotations

import asyncio
import logging
from typing import Any, Final

from dbus_fast import BusType, Message, MessageType, Variant
from dbus_fast.aio import MessageBus
from dbus_fast.errors import DBusError

from wonderland_edge_agent.receiver.errors import ReceiverError
from wonderland_edge_agent.receiver.sources import Sink
from wonderland_remote_id.errors import RemoteIdError
from wonderland_remote_id.framings.ble import SERVICE_UUID, parse_service_data
from wonderland_remote_id.framings.framed import Framed

BLUEZ: Final = "org.bluez"
ADAPTER: Final = "org.bluez.Adapter1"
DEVICE: Final = "org.bluez.Device1"
PROPERTIES: Final = "org.freedesktop.DBus.Properties"
OBJECTS: Final = "org.freedesktop.DBus.ObjectManager"
AGAIN_S: Final = 5.0

_log = logging.getLogger(__name__)


def framed_of(path: str, properties: dict[str, Variant]) -> Framed | None:
    """The frame in a device's changed properties; None where there is none. Raises `RemoteIdError`."""
    changed = properties.get("ServiceData")
    data = changed.value.get(SERVICE_UUID) if changed is not None and isinstance(changed.value, dict) else None
    if not isinstance(data, Variant) or not isinstance(data.value, bytes | bytearray):
        return None
    framed = parse_service_data(bytes(data.value))
    if framed is None:
        return None
    strength = properties.get("RSSI")
    rssi_dbm = strength.value if strength is not None and isinstance(strength.value, int) else None
    return Framed(framed.frame, framed.transport, framed.counter, _address(path), rssi_dbm)


def _address(path: str) -> str | None:
    """``…/dev_AA_BB_CC_DD_EE_FF`` → ``aa:bb:cc:dd:ee:ff``."""
    _, found, name = path.rpartition("/dev_")
    return name.replace("_", ":").lower() if found and len(name) == 17 else None


async def _disconnected(bus: MessageBus) -> None:
    # Shielded: whoever stops waiting would otherwise cancel the future that all others wait for.
    await asyncio.shield(bus.wait_for_disconnect())  # type: ignore[no-untyped-call]  # of the library


class BluezSource:
    """Has BlueZ scan, and again when it was restarted. ``address`` is that of the bus, the system's where None."""

    def __init__(self, adapter: str = "hci0", address: str | None = None) -> None:
        self._adapter = adapter
        self._address = address
        self._task: asyncio.Task[None] | None = None
        self._bus: MessageBus | None = None
        self._sink: Sink | None = None
        self.scanning = asyncio.Event()

    async def start(self, sink: Sink) -> None:
        """Begin to scan. Raises `ReceiverError` when there is no bus, no BlueZ or no such adapter."""
        self._sink = sink
        await self._connect()
        self._task = asyncio.create_task(self._keep())

    async def close(self) -> None:
        """Stop scanning; the adapter is others' again."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        if self._bus is not None and self._bus.connected:
            self._bus.disconnect()
            await _disconnected(self._bus)
        self._bus = None

    async def _connect(self) -> None:
        try:
            bus = await MessageBus(bus_address=self._address, bus_type=BusType.SYSTEM).connect()
        except (OSError, DBusError, EOFError) as cause:
            raise ReceiverError(f"remote_id.bluetooth: the system's D-Bus cannot be reached ({cause})") from cause
        self._bus = bus
        bus.add_message_handler(self._heard)
        rules = (
            f"type='signal',sender='{BLUEZ}',interface='{PROPERTIES}',member='PropertiesChanged',arg0='{DEVICE}'",
            f"type='signal',sender='{BLUEZ}',interface='{OBJECTS}',member='InterfacesAdded'",
        )
        for rule in rules:
            await self._call(
                "org.freedesktop.DBus", "/org/freedesktop/DBus", "org.freedesktop.DBus", "AddMatch", "s", rule
            )
        path = f"/org/bluez/{self._adapter}"
        await self._call(BLUEZ, path, PROPERTIES, "Set", "ssv", ADAPTER, "Powered", Variant("b", True))
        everything = {"Transport": Variant("s", "le"), "DuplicateData": Variant("b", True)}
        await self._call(BLUEZ, path, ADAPTER, "SetDiscoveryFilter", "a{sv}", everything)
        await self._call(BLUEZ, path, ADAPTER, "StartDiscovery")
        self.scanning.set()

    async def _call(
        self, destination: str, path: str, interface: str, member: str, signature: str = "", *body: Any
    ) -> None:
        assert self._bus is not None
        message = Message(
            destination=destination,
            path=path,
            interface=interface,
            member=member,
            signature=signature,
            body=list(body),
        )
        reply = await self._bus.call(message)
        if reply.message_type is MessageType.ERROR:
            why = reply.body[0] if reply.body else reply.error_name
            self._bus.disconnect()
            raise ReceiverError(f"remote_id.bluetooth: {self._adapter}: {member}: {why}; is bluetoothd running?")

    async def _keep(self) -> None:
        """Connect again whenever the bus is gone."""
        while True:
            if self._bus is not None:
                try:
                    await _disconnected(self._bus)
                except (OSError, EOFError, DBusError) as error:
                    _log.warning("Remote ID: Bluetooth is gone (%s)", error)
            self.scanning.clear()
            await asyncio.sleep(AGAIN_S)
            try:
                await self._connect()
            except ReceiverError as error:
                _log.warning("%s", error)
                self._bus = None

    def _heard(self, message: Message) -> None:
        if message.message_type is not MessageType.SIGNAL or message.path is None or self._sink is None:
            return
        if message.member == "PropertiesChanged" and message.body and message.body[0] == DEVICE:
            path, properties = message.path, message.body[1]
        elif message.member == "InterfacesAdded" and len(message.body) == 2:
            path, properties = message.body[0], message.body[1].get(DEVICE, {})
        else:
            return
        try:
            framed = framed_of(path, properties)
        except RemoteIdError:
            self._sink.take_bad()
            return
        if framed is not None:
            self._sink.take_framed(framed, f"bluetooth:{self._adapter}")
