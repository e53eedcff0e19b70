"""The options that say which drone this is and what it has, and the file that can say it instead."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import click

from wonderland.toml_settings import SettingsError
from wonderland.uwb.port_options import PORT
from wonderland_uav_agent.broadcasts import OpenDroneIdSettings
from wonderland_uav_agent.flight import FlightSettings
from wonderland_uav_agent.position.odometry import OdometrySettings
from wonderland_uav_agent.settings import WAIT_S, UavSettings, load

_SETTINGS = "wonderland_uav_agent.settings"


def _settings() -> UavSettings:
    """The file that the command was given."""
    found = click.get_current_context().meta.get(_SETTINGS, UavSettings())
    assert isinstance(found, UavSettings)
    return found


def flight_settings() -> FlightSettings | None:
    """Its ``[flight]``."""
    return _settings().flight


def open_drone_id_settings() -> OpenDroneIdSettings | None:
    """Its ``[open_drone_id]``."""
    return _settings().open_drone_id


def odometry_settings() -> OdometrySettings | None:
    """Its ``[odometry]``."""
    return _settings().odometry


def _defaults(context: click.Context, _: click.Parameter, path: Path | None) -> None:
    if path is None:
        return
    try:
        settings = load(path)
    except SettingsError as error:
        raise click.UsageError(str(error)) from error
    context.default_map = {**(context.default_map or {}), **settings.defaults()}
    context.meta[_SETTINGS] = settings


from_config = click.option(
    "--config",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    is_eager=True,
    expose_value=False,
    callback=_defaults,
    help="uav.toml: what is not said here is taken from it.",
)


def of_the_drone(command: Callable[..., None]) -> Callable[..., None]:
    """The options that say which drone this is, and what it has."""
    options = (
        from_config,
        click.option(
            "--connection", required=True, type=click.Path(path_type=Path), help="connection.json of the ledger."
        ),
        click.option("--identity", default="uav", show_default=True, help="A name in connection.json."),
        click.option(
            "--port",
            required=True,
            type=PORT,
            help="Port of the drone's UWB node: a device, socket://HOST:PORT or rfc2217://HOST:PORT.",
        ),
        click.option(
            "--node",
            type=click.Choice(("uci", "dwm1001", "dwm1001-anchor")),
            default="uci",
            show_default=True,
            help="What hangs there. With a DWM1001 tag the drone reports its own ranges, with an anchor the pad's tags "
            "measure it: assurance 0 with either.",
        ),
        click.option("--board", metavar="HEX", help="Short address of the anchor on the drone (dwm1001-anchor)."),
        click.option(
            "--words",
            type=click.Choice(("both_ways", "initiator")),
            default="both_ways",
            show_default=True,
            help="UCI: who carries data in a ranging session. No node says whether it does so as a responder, too.",
        ),
        click.option(
            "--report-to", metavar="HOST:PORT", help="Where the pad listens to drones with a DWM1001 (its uwb.listen)."
        ),
        click.option(
            "--position",
            required=True,
            metavar="mavlink:…|ros2:/TOPIC|ros2:px4|udp:HOST:PORT|track:FILE",
            help="Where the drone's position comes from: an autopilot that speaks MAVLink (mavlink:udp:HOST:PORT, "
            "mavlink:tcp:HOST:PORT, mavlink:serial:DEVICE[:BAUD]), a topic of ROS 2 (NavSatFix; Odometry with "
            "[odometry]), PX4's own topics by its Zenoh module (ros2:px4, ros2:px4:/NAMESPACE), JSON datagrams, or a "
            "recorded track (CSV).",
        ),
        click.option(
            "--mavlink-key",
            type=click.Path(path_type=Path),
            metavar="FILE",
            help="Key of MAVLink 2 signing (64 hexadecimal digits), which the autopilot has, too: nothing unsigned is "
            "heard then.",
        ),
        click.option(
            "--geoid",
            type=click.Path(path_type=Path),
            metavar="FILE",
            help="EGM96 of 15' (WW15MGH.DAC), for an autopilot (mavlink:…, ros2:px4) whose receiver states no height "
            "above the ellipsoid: those in simulation do not.",
        ),
        click.option(
            "--interfaces",
            type=click.Path(exists=True, file_okay=False, path_type=Path),
            multiple=True,
            metavar="DIRECTORY",
            help="Where .msg files of ROS 2 are (an installation's share, a workspace's install), for a PX4 whose "
            "messages are others than those known here. Several times.",
        ),
        click.option(
            "--antenna",
            "antenna_m",
            type=click.FloatRange(-5, 5),
            nargs=3,
            default=(0.0, 0.0, 0.0),
            metavar="FORWARD RIGHT DOWN",
            help="Where the UWB node's antenna is, in metres from the place that the autopilot or the odometry tells.",
        ),
        click.option(
            "--remote-id",
            metavar="mavlink|udp:HOST:PORT",
            help="Where it is said what the drone broadcasts by Remote ID; the agent signs for that, so that no "
            "impostor's broadcast is taken for the drone's. mavlink: by the link of --position mavlink:… "
            "(OPEN_DRONE_ID_*). udp: the module tells; listen on this machine alone (127.0.0.1).",
        ),
        click.option(
            "--then",
            "command",
            metavar="PROGRAM",
            help="Run with the action and the session's id once it is permitted; exit status 0 means done.",
        ),
        click.option("--whole-certificate", is_flag=True, help="Say the whole certificate over UWB, not its hash."),
        click.option(
            "--wait",
            "wait_s",
            type=click.FloatRange(0, 3_600),
            default=WAIT_S,
            show_default=True,
            help="Seconds that it waits for a pad that others use.",
        ),
        click.option("-v", "--verbose", is_flag=True, help="Say more in the log."),
    )
    for option in reversed(options):
        command = option(command)
    return command
