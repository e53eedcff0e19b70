"""What a drone's agent is told in ``uav.toml``: the same as its options, and how it flies by permission.

connection = "connection.json"          # of the ledger
identity = "uav"
port = "/dev/serial/by-id/usb-…"        # of the UWB node
position = "mavlink:serial:/dev/ttyAMA0"
antenna = [0.1, 0.0, -0.05]             # of the node, from the autopilot: forward, right, down, in metres
pads = ["pad-1"]                        # where it proves itself
backend = "wss://console.example/ingest"
backend_ca = "console-ca.pem"
orders = "ros2"                         # take orders from ROS 2, too (this machine's router)

[flight]                                # without it, nothing is asked of the autopilot
approach_m = 20                         # who begins to land so near to a pad's middle is held
gate_m = 8                              # how high above the pad it waits for its verdict
attempts = 3                            # proofs, before the landing counts as refused
refused = "hold"                        # hold, return or alternate
# alternate = { lat = 60.4521, lon = 22.2671, height_m = 45.0 }
take_off_elsewhere = "refuse"           # PX4: whether it may be armed where none of its pads is

[open_drone_id]                         # without it, the autopilot is told nothing to broadcast
operator_id = "FIN87astrdge12k8"        # beside the serial number, which is the certificate's id

[odometry]                              # with position = "ros2:/odom": where on Earth its frame lies
frame = "map"
lat = 60.4518
lon = 22.2666
height_m = 30.5
yaw_deg = 0.0
accuracy_m = 0.3
yaw_accuracy_deg = 0.5
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final, Literal

from msgspec import Meta, structs

from wonderland.toml_settings import Identifier, Table, Text, load_toml
from wonderland_uav_agent.broadcasts import OpenDroneIdSettings
from wonderland_uav_agent.flight import FlightSettings
from wonderland_uav_agent.position.odometry import OdometrySettings

WAIT_S: Final = 600.0
"""How long a drone waits for a pad that others use."""
_Arm = Annotated[float, Meta(ge=-5, le=5)]
OPTIONS: Final = {"antenna": "antenna_m", "then": "command", "wait": "wait_s", "backend": "url", "backend_ca": "tls_ca"}
"""Where an option has another name inside the command than in the file."""
TABLES: Final = frozenset({"flight", "odometry", "open_drone_id"})
"""What the command line cannot say."""


class UavSettings(Table, frozen=True, kw_only=True):
    """Any of it may be said on the command line instead; what is said there wins."""

    connection: Path | None = None
    identity: Identifier | None = None
    port: Text | None = None
    node: Literal["uci", "dwm1001", "dwm1001-anchor"] | None = None
    board: Text | None = None
    words: Literal["both_ways", "initiator"] | None = None
    report_to: Text | None = None
    position: Text | None = None
    geoid: Path | None = None
    interfaces: tuple[Path, ...] | None = None
    antenna: tuple[_Arm, _Arm, _Arm] | None = None
    mavlink_key: Path | None = None
    remote_id: Text | None = None
    then: Path | None = None
    whole_certificate: bool | None = None
    wait: Annotated[float, Meta(ge=0, le=3_600)] | None = None
    """Seconds that it waits for a pad that others use."""
    backend: Text | None = None
    backend_ca: Path | None = None
    pads: Annotated[tuple[Identifier, ...], Meta(min_length=1, max_length=64)] | None = None
    network_id: bool | None = None
    orders: Text | None = None
    flight: FlightSettings | None = None
    open_drone_id: OpenDroneIdSettings | None = None
    odometry: OdometrySettings | None = None

    def defaults(self) -> dict[str, Any]:
        """By the names that the commands' functions have."""
        given = {
            name: value for name, value in structs.asdict(self).items() if value is not None and name not in TABLES
        }
        return {OPTIONS.get(name, name): value for name, value in given.items()}


def load(path: Path) -> UavSettings:
    """Read a file. Raises SettingsError."""
    return load_toml(path, UavSettings)
