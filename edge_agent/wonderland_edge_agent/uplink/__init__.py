"""The uplink: what the spool holds, to the server, in order and once; authenticated with the ledger identity."""

from wonderland_edge_agent.uplink.errors import (
    UplinkConfigurationError,
    UplinkConnectionError,
    UplinkError,
    UplinkProtocolError,
    UplinkRefusedError,
    UplinkStalledError,
)
from wonderland_edge_agent.uplink.protocol import UplinkProtocol
from wonderland_edge_agent.uplink.transport import Connected, Transport
from wonderland_edge_agent.uplink.uplink import Uplink, UplinkStatus, UplinkTimings
from wonderland_edge_agent.uplink.ways import way_to
from wonderland_edge_agent.uplink.websocket import WebSocketTransport

__all__ = [
    "Connected",
    "Transport",
    "Uplink",
    "UplinkConfigurationError",
    "UplinkConnectionError",
    "UplinkError",
    "UplinkProtocol",
    "UplinkProtocolError",
    "UplinkRefusedError",
    "UplinkStalledError",
    "UplinkStatus",
    "UplinkTimings",
    "WebSocketTransport",
    "way_to",
]
