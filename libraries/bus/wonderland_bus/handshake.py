"""Why a router does not let a peer in: Zenoh says only that it could not connect, so a plain TLS handshake asks."""

from __future__ import annotations

import contextlib
import socket
import ssl
from typing import Final

from wonderland_bus.settings import Member, Tls, address_of

_TIMEOUT_S: Final = 3.0
_ALERT_S: Final = 0.5
_ALERTS: Final = {
    "UNKNOWN_CA": "does not know the authority that issued this certificate",
    "CERTIFICATE_EXPIRED": "says that this certificate has expired",
    "DECRYPT_ERROR": "knows an authority of that name, which did not issue this certificate",
    "BAD_CERTIFICATE": "does not take this certificate",
    "CERTIFICATE_REQUIRED": "wants a certificate",
}


def refusals(member: Member) -> list[str]:
    """One line for each router that cannot be used, and why. It blocks for a few seconds."""
    found = []
    for router in member.routers:
        why = _refusal(router, member.tls)
        if why:
            found.append(f"router {router} {why}")
    return found


def _refusal(router: str, tls: Tls) -> str:
    host, port = address_of(router, "routers")
    try:
        context = ssl.create_default_context(cafile=str(tls.ca))
        context.load_cert_chain(tls.certificate, tls.key)
    except OSError as cause:
        return f"cannot be asked: {tls.ca}, {tls.certificate} or {tls.key} is no good ({cause})"
    try:
        with (
            socket.create_connection((host, port), _TIMEOUT_S) as plain,
            context.wrap_socket(plain, server_hostname=host) as link,
        ):
            # In TLS 1.3 the server looks at a certificate after the client is done: its alert comes by itself.
            link.settimeout(_ALERT_S)
            with contextlib.suppress(TimeoutError):
                link.recv(1)
    except ssl.SSLCertVerificationError as cause:
        return f"shows a certificate that is not believed ({cause.verify_message}); is the address right, and ca?"
    except ssl.SSLError as cause:
        for alert, text in _ALERTS.items():
            if alert in (cause.reason or ""):
                return text
        return f"ends the handshake ({cause.reason or cause}); does it listen for TLS there?"
    except OSError as cause:
        return f"is not reached ({cause.strerror or cause})"
    return ""
