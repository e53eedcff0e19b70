"""One's own pads and drones, before hardware comes: virtual nodes on ports, by a scenario file.

- ``description``: what a scenario file may say (YAML). ``reading``: read, with what is wrong and on which line.
- ``tour``: a vehicle on its way. ``world``: all of them, their nodes and their words. ``faults``: what breaks when.
- ``showing``: how far it is, for people. ``writing``: pad.toml and uav.toml that fit.
"""
