"""The receiver's sources, as they are configured."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wonderland_edge_agent.receiver.errors import ReceiverError

if TYPE_CHECKING:
    from wonderland_edge_agent.receiver.settings import ReceiverSettings
    from wonderland_edge_agent.receiver.sources import Source


def sources_of(settings: ReceiverSettings) -> list[Source]:
    """The configured sources, each imported only here. Raises `ReceiverError` where a package is missing."""
    sources: list[Source] = []
    try:
        if settings.mavlink:
            from wonderland_edge_agent.receiver.sources.serial import SerialMavlink  # noqa: PLC0415 - only what is configured

            sources += [SerialMavlink(f"mavlink:{index}", port) for index, port in enumerate(settings.mavlink)]
        if settings.mqtt is not None:
            from wonderland_edge_agent.receiver.sources.mqtt import MqttSource  # noqa: PLC0415

            sources.append(MqttSource(settings.mqtt))
        if settings.bluetooth is not None:
            from wonderland_edge_agent.receiver.sources.bluez import BluezSource  # noqa: PLC0415

            sources.append(BluezSource(settings.bluetooth))
        if settings.wifi is not None:
            from wonderland_edge_agent.receiver.sources.wifi_monitor import WifiMonitorSource  # noqa: PLC0415

            sources.append(WifiMonitorSource(settings.wifi))
        if settings.replay is not None:
            from wonderland_edge_agent.receiver.sources.replay import ReplaySource  # noqa: PLC0415

            sources.append(ReplaySource(settings.replay, settings.replay_speed_percent / 100))
    except ModuleNotFoundError as missing:
        raise ReceiverError(
            f"remote_id: the package {missing.name} is not installed; pip install 'wonderland-edge-agent[receivers]'"
        ) from missing
    return sources
