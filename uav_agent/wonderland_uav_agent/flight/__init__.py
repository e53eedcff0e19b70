"""Flying by permission: the autopilot is held above a pad until a verdict is committed that permits the landing.

``vehicle`` says what the autopilot does, ``gatekeeper`` decides what it should do, ``orders`` turns that into commands
that are acknowledged; ``guidance`` and ``precision`` find the way down by the ranges; all of them are pure.
``pilot`` joins them to a MAVLink link and to the drone's agent.
"""

from wonderland_uav_agent.flight.approach import Gate
from wonderland_uav_agent.flight.gatekeeper import Gatekeeper
from wonderland_uav_agent.flight.pilot import Pilot
from wonderland_uav_agent.flight.settings import FlightSettings

__all__ = ["FlightSettings", "Gate", "Gatekeeper", "Pilot"]
