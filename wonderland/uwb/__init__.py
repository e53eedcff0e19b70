"""Ultra-wideband radios: the FiRa UWB Command Interface, serial ports that survive unplugging, the secure link.

Layers, each usable alone:

* ``uci``: sans-I/O codec and host-side state machine of the FiRa UWB Command Interface.
* ``serial_port``: an asyncio byte pipe to a serial device that may vanish and return.
* ``layout``: which session configuration each node of a pad and a drone gets.
* ``node``: one node on one port, asynchronous: sessions, measurements, data.
* ``dwm1001``: the paper's board with its factory firmware: codecs, state machine, node; ranges are the tag's own.
* ``listen``, ``commands``: a board at the bench (``wonderland uwb listen``).
* ``link``: the encrypted, acknowledged messages that ride in the data frames (sans-I/O).
"""
