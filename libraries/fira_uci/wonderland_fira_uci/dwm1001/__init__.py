"""The Decawave DWM1001, the paper's board, with its factory firmware (PANS R2) or that firmware's successor (LEAPS).

* ``tlv``, ``shell``: sans-I/O codecs of the two ways in which the board talks.
* ``device``: the host's side as a state machine, no I/O.
* ``node``: one board on one serial port, asynchronous.

With this firmware the *tag* computes the ranges. A tag on a drone therefore gives what the drone says about itself
(assurance 0); see ``docs/decisions/0004-ranges-a-drone-reports.md``.
"""

from wonderland_fira_uci.dwm1001.device import Dwm1001Device, Mode
from wonderland_fira_uci.dwm1001.errors import (
    Dwm1001DecodeError,
    Dwm1001EncodeError,
    Dwm1001Error,
    Dwm1001StatusError,
)
from wonderland_fira_uci.dwm1001.node import Dwm1001Node, TimedReport
from wonderland_fira_uci.dwm1001.reports import (
    AnchorDistance,
    BoardPosition,
    Configuration,
    Generation,
    HeardPosition,
    LocationReport,
    Report,
    Version,
)
from wonderland_fira_uci.dwm1001.talk import BoardEvent, BoardLost, BoardReady, Reported, Timings

__all__ = [
    "AnchorDistance",
    "BoardEvent",
    "BoardLost",
    "BoardPosition",
    "BoardReady",
    "Configuration",
    "Dwm1001DecodeError",
    "Dwm1001Device",
    "Dwm1001EncodeError",
    "Dwm1001Error",
    "Dwm1001Node",
    "Dwm1001StatusError",
    "Generation",
    "HeardPosition",
    "LocationReport",
    "Mode",
    "Report",
    "Reported",
    "TimedReport",
    "Timings",
    "Version",
]
