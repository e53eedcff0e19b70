"""``wonderland uav serve --check``: what its settings say, without opening anything."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from wonderland_fabric_gateway.connection import Connection
from wonderland_uav_agent.broadcasts import BroadcastError, OpenDroneIdSettings
from wonderland_uav_agent.flight import FlightSettings
from wonderland_uav_agent.position.mavlink import SerialAddress, parse_address
from wonderland_uav_agent.position.mavlink.signing import read_key
from wonderland_uav_agent.position.odometry import OdometrySettings
from wonderland_uav_agent.ros2_orders import link_of
from wonderland_uav_agent.sources import LOOPBACK, needs_key

_REFUSED = {
    "hold": "stays above the pad",
    "return": "returns to launch",
    "alternate": "goes to its alternate and stays there",
}


def explained(
    url: str | None,
    pads: frozenset[str],
    identity: str,
    flight: FlightSettings | None,
    options: dict[str, Any],
    open_drone_id: OpenDroneIdSettings | None = None,
) -> list[str]:
    """A line for each part. Raises LedgerError, PositionError or BroadcastError for what cannot be."""
    where = Connection.load(options["connection"])
    who = where.identity(identity)
    said = [
        f"This is drone {who.pol_id} ({who.msp_id}), on channel {where.channel} by way of {where.gateway.address}.",
        f"Its UWB node ({options['node']}) is at {options['port']}.",
        *_position(options["position"], options["mavlink_key"], options["geoid"], flown=flight is not None),
        *_odometry(options["odometry"]),
        *_antenna(options["antenna_m"]),
        *_broadcast(options["remote_id"], open_drone_id, who.pol_id, options["position"]),
        *_asked(pads, url, options["orders"]),
    ]
    if options["command"] is not None and flight is not None:
        said.append("--then is not run: with [flight] the autopilot does what is permitted.")
    elif options["command"] is not None:
        said.append(f"What is permitted is done by {options['command']}.")
    return said + (
        _flight(flight) if flight is not None else ["Nothing is asked of an autopilot ([flight] is not set)."]
    )


def _antenna(antenna_m: tuple[float, float, float]) -> list[str]:
    forward, right, down = (f"{way:g}" for way in antenna_m)
    where = f"{forward} m forward, {right} m right, {down} m down of the place that its position source tells"
    return [f"The node's antenna is {where}."] if any(antenna_m) else []


def _broadcast(remote_id: str | None, told: OpenDroneIdSettings | None, uav_id: str, position: str) -> list[str]:
    if position.partition(":")[0] != "mavlink" and (remote_id == "mavlink" or told is not None):
        raise BroadcastError("--remote-id mavlink and [open_drone_id]: only with --position mavlink:…")
    said = [] if remote_id is None else [f"It signs for what it broadcasts, by the word of {remote_id}."]
    if told is not None:
        operator = told.public_operator_id
        named = "no operator" if operator is None else f"operator {operator}"
        said.append(f"The autopilot is told to broadcast serial number {uav_id} and {named}.")
    return said


def _asked(pads: frozenset[str], url: str | None, orders: str | None) -> list[str]:
    if orders is not None:
        link_of(orders)
    where = f"It proves itself at {', '.join(sorted(pads))} when"
    if url is None and orders is None:
        return [f"{where} it begins to land there; nobody else asks it (--backend, --orders)."]
    said = [] if url is None else [f"{where} it is asked over {url}."]
    by_ros = f"{where} a program on this machine orders it by ROS 2 ({orders}): whoever reaches its graph."
    return said if orders is None else [*said, by_ros]


def _odometry(said: OdometrySettings | None) -> list[str]:
    if said is None:
        return []
    where = f"{said.lat:.7f}, {said.lon:.7f}, {said.height_m:g} m above the ellipsoid (to {said.accuracy_m:g} m)"
    ways = f"its x axis {said.yaw_deg:g}° from east, counter-clockwise (to {said.yaw_accuracy_deg:g}°)"
    return [f"Its positions are of an odometry in frame {said.frame}, whose origin is at {where}, {ways}."]


def _position(text: str, key_file: Path | None, geoid: Path | None, *, flown: bool) -> list[str]:
    kind, _, rest = text.partition(":")
    if kind != "mavlink":
        return [f"Its position comes from {text}, and is believed as it comes."]
    where = parse_address(rest)
    needs_key(where, key_file, flown=flown)
    if key_file is not None:
        read_key(key_file)
        signed = f"signed with the key of {key_file}"
    elif isinstance(where, SerialAddress) or where.host in LOOPBACK:
        signed = "not signed: whoever can write there says where it is"
    else:
        signed = "not signed, over a network: whoever reaches it says where it is"
    heights = "" if geoid is None else f" Heights above the ellipsoid by {geoid} where the receiver has none."
    return [f"Its position comes from the autopilot at {where}, {signed}.{heights}"]


def _flight(flight: FlightSettings) -> list[str]:
    held = f"Who begins to land within {flight.approach_m:g} m of a pad is held {flight.gate_m:g} m above it"
    after = f"after {flight.attempts} proofs without one it {_REFUSED[flight.refused]}"
    return [
        f"{held} until a committed verdict permits the landing; {after}.",
        "The pilot and the autopilot's fail-safes always win.",
        f"It lands by {'the ranges of its node (LANDING_TARGET)' if flight.precision else 'its own position alone'}.",
        f"PX4 that asks whether it may be armed where none of its pads is: {flight.take_off_elsewhere}.",
    ]
