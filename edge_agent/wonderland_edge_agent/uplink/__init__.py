"""The uplink: what the spool holds, to the server, in order and once; authenticated with the ledger identity."""

from wonderland_edge_agent.uplink.errors import (
    UplinkConfigurationError,
    UplinkError,
    UplinkProtocolError,
    UplinkRefusedError,
    UplinkStalledError,
)
from wonderland_edge_agent.uplink.protocol import Credentials, UplinkProtocol
from wonderland_edge_agent.uplink.uplink import Uplink, UplinkStatus, UplinkTimings

__all__ = [
    "Credentials",
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
