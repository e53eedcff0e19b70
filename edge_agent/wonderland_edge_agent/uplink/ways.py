"""Which way an address asks for."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from wonderland.telemetry import tls_of
from wonderland_edge_agent.uplink.errors import UplinkConfigurationError
from wonderland_edge_agent.uplink.transport import Transport
from wonderland_edge_agent.uplink.websocket import WebSocketTransport
from wonderland_fabric_gateway.connection import ClientTls

ZENOH: Final = "zenoh+tls://"


def way_to(url: str, *, ca: Path | None, client: ClientTls | None, allow_plaintext: bool = False) -> Transport:
    """`ca`: whom to believe, in place of this machine's authorities; `client`: what to show, who is asked.

    Raises `UplinkConfigurationError`.
    """
    if url.startswith(ZENOH):
        return _over_zenoh(url, ca, client)
    context = None
    if url.startswith("wss:"):
        try:
            context = tls_of(ca, client)
        except OSError as cause:  # ssl.SSLError is one
            shown = "" if client is None else f", or {client.certificate} with {client.key} cannot be shown"
            raise UplinkConfigurationError(f"tls_ca: {ca} is no certificate authority{shown} ({cause})") from cause
    return WebSocketTransport(url, ssl_context=context, allow_plaintext=allow_plaintext)


def _over_zenoh(url: str, ca: Path | None, client: ClientTls | None) -> Transport:
    try:
        from wonderland_edge_agent.uplink.zenoh import ZenohTransport  # noqa: PLC0415 - an extra
    except ImportError as cause:
        raise UplinkConfigurationError(
            f'{ZENOH} needs what is not installed: pip install "wonderland-edge-agent[zenoh]" ({cause})'
        ) from cause
    if ca is None:
        raise UplinkConfigurationError("tls_ca is missing: on the bus no public authority is believed")
    if client is None:
        raise UplinkConfigurationError(
            "the bus wants a certificate with its key in a file: client_tls in connection.json, where the ledger's key "
            "is in a module"
        )
    return ZenohTransport(url, ca, client)
