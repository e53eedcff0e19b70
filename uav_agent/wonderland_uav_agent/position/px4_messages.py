"""What is read of PX4's uORB topics by ROS 2: fields of ``px4_msgs``, in the order of the wire.

PX4 counts versions of some messages and of others not: SensorGps has changed from release to release, and which one a
peer has, its type hash says. Constants, which no message carries, are not here.
"""

from __future__ import annotations

from typing import Final

POSITION: Final = "px4_msgs/msg/VehicleGlobalPosition"
GPS: Final = "px4_msgs/msg/SensorGps"
ATTITUDE: Final = "px4_msgs/msg/VehicleAttitude"

_TIMES: Final = "uint64 timestamp\nuint64 timestamp_sample\n"
_GPS_HEAD: Final = f"""{_TIMES}uint32 device_id
float64 latitude_deg
float64 longitude_deg
float64 altitude_msl_m
float64 altitude_ellipsoid_m
float32 s_variance_m_s
float32 c_variance_rad
uint8 fix_type
float32 eph
float32 epv
float32 hdop
float32 vdop
int32 noise_per_ms
uint16 automatic_gain_control
uint8 jamming_state
int32 jamming_indicator
uint8 spoofing_state
"""
_GPS_MOTION: Final = """float32 vel_m_s
float32 vel_n_m_s
float32 vel_e_m_s
float32 vel_d_m_s
float32 cog_rad
bool vel_ned_valid
int32 timestamp_time_relative
uint64 time_utc_usec
uint8 satellites_used
"""
_GPS_TAIL: Final = """float32 heading
float32 heading_offset
float32 heading_accuracy
float32 rtcm_injection_rate
uint8 selected_rtcm_instance
bool rtcm_crc_failed
uint8 rtcm_msg_used
"""
_GPS_2024: Final = _GPS_HEAD + _GPS_MOTION + _GPS_TAIL
_GPS_2025: Final = f"{_GPS_HEAD}uint8 authentication_state\n{_GPS_MOTION}uint32 system_error\n{_GPS_TAIL}"
_GPS_2026: Final = f"{_GPS_2025}float32 antenna_offset_x\nfloat32 antenna_offset_y\nfloat32 antenna_offset_z\n"

DEFINITIONS: Final = {
    POSITION: (
        f"""{_TIMES}float64 lat
float64 lon
float32 alt
float32 alt_ellipsoid
bool lat_lon_valid
bool alt_valid
float32 delta_alt
float32 delta_terrain
uint8 lat_lon_reset_counter
uint8 alt_reset_counter
uint8 terrain_reset_counter
float32 eph
float32 epv
float32 terrain_alt
bool terrain_alt_valid
bool dead_reckoning
""",
    ),
    GPS: (_GPS_2026, _GPS_2025, _GPS_2024),
    ATTITUDE: (f"{_TIMES}float32[4] q\nfloat32[4] delta_q_reset\nuint8 quat_reset_counter\n",),
}
"""By type, the newest first: those of PX4 since its Zenoh module has type hashes (1.17)."""
