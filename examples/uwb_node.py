"""The FiRa UWB Command Interface without a port: octets of a node in, events out."""

from wonderland_fira_uci.uci.codec import HostCodec

codec = HostCodec()
codec.receive_data(bytes.fromhex("60010001"))  # half of a notification …
codec.receive_data(bytes.fromhex("01"))  # … and the rest of it
for event in codec.events():
    print(event)
# A node on a serial port, that is unplugged now and then: wonderland_fira_uci.node.UwbNode
