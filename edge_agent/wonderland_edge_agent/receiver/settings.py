"""The ``[remote_id]`` part of ``pad.toml``: what the pad hears Remote ID with, and whom it believes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

from msgspec import Meta

from wonderland.toml_settings import Address, FieldError, Table, Text
from wonderland_edge_agent.receiver.errors import ReceiverError

if TYPE_CHECKING:
    from wonderland_remote_id.drip.registry import Registry

NOT_TRUSTWORTHY: Final = "NOT TRUSTWORTHY"
LOOPBACK: Final = frozenset({"localhost", "127.0.0.1", "::1"})


class MqttSettings(Table, frozen=True):
    """A broker and what to hear there."""

    host: Text
    """The broker."""
    topics: Annotated[tuple[Text, ...], Meta(min_length=1)]
    """Topics, or filters with ``#`` and ``+``."""
    port: Annotated[int, Meta(ge=1, le=65_535)] | None = None
    """Left out: 8883 with `tls_ca`, else 1883."""
    protocol: Literal["5", "3.1.1"] = "5"
    """3.1.1 for brokers that know no MQTT 5."""
    tls_ca: Path | None = None
    """The broker’s certificate authority (PEM); without it nothing is encrypted."""
    username: Text | None = None
    """As whom to sign in."""
    password_file: Path | None = None
    """A file with the password."""

    def __post_init__(self) -> None:
        if self.password_file is not None and self.username is None:
            raise FieldError("username is missing beside password_file")
        if self.password_file is not None and self.tls_ca is None and self.host not in LOOPBACK:
            raise FieldError("tls_ca is missing: a password would cross the network for everybody to read")

    @property
    def broker_port(self) -> int:
        """The port that was given, or the one that is usual with TLS or without."""
        return self.port or (1883 if self.tls_ca is None else 8883)


class ReceiverSettings(Table, frozen=True):
    """Receivers; none of them by default."""

    listen: Address | None = None
    """UDP."""
    serial: tuple[Text, ...] = ()
    """Serial devices of receivers that say one Remote ID message a line."""
    mavlink: tuple[Text, ...] = ()
    """Serial devices that speak MAVLink 2 (DroneScout Bridge)."""
    mqtt: MqttSettings | None = None
    bluetooth: Text | None = None
    """BlueZ's adapter, for example hci0."""
    wifi: Text | None = None
    """An interface in monitor mode, for example wlan1."""
    replay: Path | None = None
    """A capture that is played in place of a receiver."""
    replay_speed_percent: Annotated[int, Meta(ge=0, le=10_000)] = 100
    """How fast it is played; 0: without waiting."""
    drip: Path | None = None
    """The registries of DRIP identities that this pad believes (JSON)."""


def trust(settings: ReceiverSettings) -> list[str]:
    """Who can make the pad hear what, source by source: for the operator.

    A serial number can be broadcast by anybody; a verdict takes that into account. These are the sources through which
    one can do so from afar, without any transmitter near the pad.
    """
    said = []
    listen = settings.listen
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
    radios = (*settings.serial, *settings.mavlink, *filter(None, (settings.bluetooth, settings.wifi)))
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
