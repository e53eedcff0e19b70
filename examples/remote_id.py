"""Remote ID (ASTM F3411-22a): encode a pack as it goes on the air, and decode it."""

from wonderland_remote_id import BasicId, HorizontalAccuracy, Location, Pack, UaType, decode, encode

frame = encode(
    Pack(
        messages=(
            BasicId(uas_id="1581F5FKD229400A1234", ua_type=UaType.HELICOPTER_OR_MULTIROTOR),
            Location(
                lat_e7=604_518_000,
                lon_e7=222_666_000,
                altitude_mm=61_000,
                horizontal_accuracy=HorizontalAccuracy.M_3,
                after_hour_ms=600_000,
            ),
        )
    )
)
print(f"{len(frame)} bytes: {frame.hex()}")
for message in decode(frame).messages:
    print(message)
# A capture (pcap, Bluetooth or Wi-Fi): wonderland-remote-id decode capture.pcap
