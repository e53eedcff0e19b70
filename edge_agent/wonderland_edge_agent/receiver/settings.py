"""The ``[remote_id]`` part of ``pad.toml`` beyond ``listen`` and ``serial``, and the sources that it configures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

from wonderland_edge_agent.receiver.errors import ReceiverError

if TYPE_CHECKING:
    from wonderland_remote_id.drip.registry import Registry

NOT_TRUSTWORTHY: Final = "NOT TRUSTWORTHY"
LOOPBACK: Final = frozenset({"localhost", "127.0.0.1", "::1"})


@dataclass(frozen=True, slots=True, kw_only=True)
class MqttSettings:
    """A broker and what to hear there."""

    host: str
    topics: tuple[str, ...]
    port: int = 1883
    protocol: str = "5"
    """Or 3.1.1, for brokers that know no MQTT 5."""
    tls_ca: Path | None = None
    username: str | None = None
    password_file: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverSettings:
    """Receivers beside UDP and serial lines; none of them by default."""

    mavlink: tuple[str, ...] = ()
    """Serial devices that speak MAVLink 2 (DroneScout Bridge)."""
    mqtt: MqttSettings | None = None
    bluetooth: str | None = None
    """BlueZ's adapter, for example hci0."""
    wifi: str | None = None
    """An interface in monitor mode, for example wlan1."""
    replay: Path | None = None
    """A capture that is played in place of a receiver."""
    replay_speed_percent: int = 100
    drip: Path | None = None
    """The registries of DRIP identities that this pad believes (JSON)."""


class Table(Protocol):
    """A table of the settings file, as `wonderland_edge_agent.settings` reads it."""

    def has(self, name: str) -> bool: ...  # noqa: D102 - the same as there
    def text(self, name: str, default: str | None = None) -> str: ...  # noqa: D102
    def texts(self, name: str) -> tuple[str, ...]: ...  # noqa: D102
    def path(self, name: str) -> Path: ...  # noqa: D102
    def integer(self, name: str, default: int, minimum: int, maximum: int) -> int: ...  # noqa: D102
    def table(self, name: str) -> Any: ...  # noqa: D102
    def wrong(self, name: str, why: str) -> Exception: ...  # noqa: D102
    def refuse_unknown(self) -> None: ...  # noqa: D102


def parse_receivers(remote_id: Table) -> ReceiverSettings:
    """The settings in ``[remote_id]``. Raises `SettingsError` as its table does."""
    return ReceiverSettings(
        mavlink=remote_id.texts("mavlink"),
        mqtt=_mqtt(remote_id.table("mqtt")) if remote_id.has("mqtt") else None,
        bluetooth=remote_id.text("bluetooth") if remote_id.has("bluetooth") else None,
        wifi=remote_id.text("wifi") if remote_id.has("wifi") else None,
        replay=remote_id.path("replay") if remote_id.has("replay") else None,
        replay_speed_percent=remote_id.integer("replay_speed_percent", 100, 0, 10_000),
        drip=remote_id.path("drip") if remote_id.has("drip") else None,
    )


def _mqtt(table: Table) -> MqttSettings:
    settings = MqttSettings(
        host=table.text("host"),
        topics=table.texts("topics"),
        port=table.integer("port", 8883 if table.has("tls_ca") else 1883, 1, 65_535),
        protocol=table.text("protocol") if table.has("protocol") else "5",
        tls_ca=table.path("tls_ca") if table.has("tls_ca") else None,
        username=table.text("username") if table.has("username") else None,
        password_file=table.path("password_file") if table.has("password_file") else None,
    )
    table.refuse_unknown()
    if settings.protocol not in {"5", "3.1.1"}:
        raise table.wrong("protocol", "is the MQTT version: 5 or 3.1.1")
    if not settings.topics:
        raise table.wrong("topics", 'is empty; name what to hear, for example ["dronescout/#"]')
    if settings.password_file is not None and settings.username is None:
        raise table.wrong("username", "is missing beside password_file")
    if settings.password_file is not None and settings.tls_ca is None and settings.host not in LOOPBACK:
        raise table.wrong("tls_ca", "is missing: a password would cross the network for everybody to read")
    return settings


def trust(listen: tuple[str, int] | None, serial: tuple[str, ...], settings: ReceiverSettings) -> list[str]:
    """Who can make the pad hear what, source by source: for the operator.

    A serial number can be broadcast by anybody; a verdict takes that into account. These are the sources through which
    one can do so from afar, without any transmitter near the pad.
    """
    said = []
    if listen is not None:
        who = (
            "the programs of this machine"
            if listen[0] in LOOPBACK
            else f"{NOT_TRUSTWORTHY}: every machine that reaches this address, under any serial number"
        )
        said.append(f"remote_id.listen (UDP {listen[0]}:{listen[1]}): {who}")
    mqtt = settings.mqtt
    if mqtt is not None and (mqtt.tls_ca is not None or mqtt.host in LOOPBACK):
        said.append(f"remote_id.mqtt ({mqtt.host}): whoever may publish at that broker")
    elif mqtt is not None:
        said.append(
            f"remote_id.mqtt ({mqtt.host}): {NOT_TRUSTWORTHY} without tls_ca: everybody on the way to the broker"
        )
    radios = (*serial, *settings.mavlink, *filter(None, (settings.bluetooth, settings.wifi)))
    said += [f"remote_id ({radio}): transmitters near the pad" for radio in radios]
    if settings.replay is not None:
        said.append(f"remote_id.replay ({settings.replay}): {NOT_TRUSTWORTHY}: a recording, nothing that is on the air")
    return said


def registry_of(settings: ReceiverSettings) -> Registry | None:
    """The DRIP registries that the pad believes. Raises `ReceiverError` for a file that cannot be used."""
    if settings.drip is None:
        return None
    from wonderland_remote_id.drip.det import DripError  # noqa: PLC0415 - only where it is configured
    from wonderland_remote_id.drip.registry import Registry  # noqa: PLC0415

    try:
        return Registry.load(settings.drip)
    except DripError as error:
        raise ReceiverError(f"remote_id.drip: {error}") from error
