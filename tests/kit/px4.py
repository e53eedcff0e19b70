"""PX4's Zenoh module as it speaks: keys, tokens and attachments of its own, and its whole buffer behind each message."""

from __future__ import annotations

import json
import os
import struct
from types import SimpleNamespace

import zenoh

from wonderland_uav_agent.position.px4_messages import ATTITUDE, GPS, POSITION
from wonderland_uav_agent.position.ros2 import known_types

NAMES = {
    POSITION: "vehicle_global_position",
    GPS: "vehicle_gps_position",
    ATTITUDE: "vehicle_attitude",
}
MARGIN = 24
"""So many octets of its stack PX4 sends behind each message, and those of padding that the structure in memory has."""


def position_of(boot_us, **changed):
    """VehicleGlobalPosition over the Aura in Turku, good to half a metre."""
    return {
        "timestamp": boot_us,
        "timestamp_sample": boot_us,
        "lat": 60.4518,
        "lon": 22.2666,
        "alt": 12.5,
        "alt_ellipsoid": 31.0,
        "lat_lon_valid": True,
        "alt_valid": True,
        "eph": 0.5,
        "epv": 0.8,
    } | changed


def gps_of(boot_us, utc_us, **changed):
    """SensorGps, a little worse than the filter in the plane and better in height."""
    return {
        "timestamp": boot_us,
        "latitude_deg": 60.4518,
        "longitude_deg": 22.2666,
        "altitude_msl_m": 12.4,
        "altitude_ellipsoid_m": 30.9,
        "fix_type": 3,
        "eph": 0.7,
        "epv": 0.6,
        "timestamp_time_relative": 0,
        "time_utc_usec": utc_us,
    } | changed


def message(values):
    """As the core has it, without a wire; what is left out is 0."""
    zeros = {"lat_lon_valid": False, "alt_valid": False, "dead_reckoning": False}
    return SimpleNamespace(**(zeros | values))


class Px4Peer:
    """A session of its own, through a router or directly."""

    def __init__(self, endpoint, *, space="", guid=None, release=0):
        config = zenoh.Config()
        for name, value in {
            "mode": "client",
            "connect/endpoints": [endpoint],
            "scouting/multicast/enabled": False,
        }.items():
            config.insert_json5(name, json.dumps(value))
        self.session = zenoh.open(config)
        self.guid = guid or os.urandom(16)
        self._space = space
        self._seq = dict.fromkeys(NAMES, 0)
        self._types, seen = {}, {}
        for (name, _), kind in known_types().items():
            seen.setdefault(name, []).append(kind)
        for name, kinds in seen.items():
            self._types[name] = kinds[min(release, len(kinds) - 1)]
        zid = f"{int(str(self.session.info.zid()), 16):032x}"
        self._tokens = [
            self.session.liveliness().declare_token(token)
            for token in (
                f"@ros2_lv/0/{zid}/0/0/NN/%/%/px4_{self.guid.hex()}",
                *(
                    f"@ros2_lv/0/{zid}/0/11/MP/%/%/px4_{self.guid.hex()}/{self.topic(kind).replace('/', '%')}/"
                    f"{self.dds(kind)}/::,7:,:,:,,"
                    for kind in NAMES
                ),
            )
        ]

    def topic(self, kind):
        return f"{self._space}/fmu/out/{NAMES[kind]}"

    def dds(self, kind):
        return f"px4_msgs::msg::dds_::{kind.rpartition('/')[2]}_/{self._types[kind].hash}"

    def put(self, kind, values, *, data=None, seq=None):
        self._seq[kind] = self._seq[kind] + 1 if seq is None else seq
        beside = struct.pack("<qqB16s", self._seq[kind], values.get("timestamp", 0), 16, self.guid)
        if data is None:
            data = self._types[kind].codec.encode(values) + os.urandom(MARGIN)
        self.session.put(f"0{self.topic(kind)}/{self.dds(kind)}", data, attachment=beside)

    def close(self):
        self.session.close()
