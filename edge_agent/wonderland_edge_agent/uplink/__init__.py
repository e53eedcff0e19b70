"""The uplink: what the spool holds, to the server, in order and once; authenticated with the ledger identity."""

from wonderland_edge_agent.uplink.errors import (
    UplinkConfigurationError,
    UplinkError,
    UplinkProtocolError,
    UplinkRefusedError,
    UplinkStalledError,
)
from wonderland_edge_agent.uplink.protocol import UplinkProtocol
from wonderland_edge_agent.uplink.uplink import Uplink, UplinkStatus, UplinkTimings

__all__ = [
    "Uplink",
    "UplinkConfigurationError",
    "UplinkError",
    "UplinkProtocol",
    "UplinkProtocolError",
    "UplinkRefusedError",
    "UplinkStalledError",
    "UplinkStatus",
    "UplinkTimings",
]
