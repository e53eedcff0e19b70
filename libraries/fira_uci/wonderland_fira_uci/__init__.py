"""Ultra-wideband radios: the FiRa UWB Command Interface, and serial ports that survive unplugging.

Layers, each usable alone:

* ``uci``: sans-I/O codec and host-side state machine of the FiRa UWB Command Interface.
* ``serial_port``: an asyncio byte pipe to a serial device that may vanish and return.
* ``node``: one node on one port, asynchronous: sessions, measurements, data; ``events``: what it tells.
* ``dwm1001``: Qorvo's DWM1001 with its factory firmware: codecs, state machine, node; ranges are the tag's own.
"""
