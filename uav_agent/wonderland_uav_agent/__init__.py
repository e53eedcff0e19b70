"""The drone's companion computer: it asks for a proof, answers over UWB, countersigns what was measured, and acts.

``session`` holds the drone's side of the eight steps as a machine without I/O; ``position`` where its claims come
from; ``agent`` the shell with ledger, node and callbacks, many of which may run in one process.
"""
