"""How a contract service is set up, checked before it listens."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from wonderland_chaincode.service.errors import SettingsError
from wonderland_fabric_gateway.addresses import is_loopback, split_address

PACKAGE_ID: Final = re.compile(r"[A-Za-z0-9]+(?:[.+_-][A-Za-z0-9]+)*:[0-9a-f]{64}")
"""As Fabric makes it: the package's label, and the SHA-256 of the package (``core/chaincode/persistence``)."""


@dataclass(frozen=True)
class Limits:
    """What one service takes on. Times in seconds."""

    max_in_flight: int = 1000
    """Transactions at once from one peer; Fabric's own default for a peer is 2500."""
    max_streams: int = 64
    handshake_s: float = 30.0
    answer_s: float = 60.0
    """How long a peer may take for one read or write. It gives a transaction up after 30 s itself."""
    time_window_s: float = 15 * 60.0
    """How far a transaction's time may be from this machine's; Fabric's ``peer.authentication.timewindow``."""
    drain_s: float = 10.0
    """How long transactions under way may take to end when the service is stopped."""


def check_package_id(text: str) -> str:
    """The package id itself. Raises `SettingsError` unless it is LABEL:HASH."""
    if not PACKAGE_ID.fullmatch(text):
        raise SettingsError(
            f"{text[:100]!r} is no package id: LABEL:HASH with 64 hexadecimal digits, as installing the package said"
        )
    return text


def check_listen(listen: str, *, encrypted: bool, plaintext: bool) -> None:
    """Raise `AddressError` for no address, `SettingsError` for other machines' access without TLS unasked."""
    host, _ = split_address(listen)
    if encrypted or plaintext or is_loopback(host):
        return
    raise SettingsError(
        f"{listen} can be reached by other machines: whoever stands between a peer and its contract decides what the "
        "peer signs. Give --tls-cert, --tls-key and --client-ca (or --plaintext inside a network that is protected)"
    )
