"""A stand-in for rclpy by PyPI zenoh-ros2-sdk: as much as rmf-web's server asks of it, which is run as it is.

The wire, the hashes and the reading are that library's; none of it is this project's.
"""

from __future__ import annotations

import queue
import threading

_ended = threading.Event()
_calls: queue.Queue = queue.Queue()


def init(args=None):
    _ended.clear()


def shutdown():
    _ended.set()


def spin(node):
    """Callbacks run in the thread that spins."""
    while not _ended.is_set():
        try:
            call, message = _calls.get(timeout=0.05)
        except queue.Empty:
            continue
        call(message)
