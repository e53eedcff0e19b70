"""The address that people know this server by."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import urlsplit

from wonderland_backend.settings import Settings

LOCAL = "localhost"


@dataclass(frozen=True)
class Site:
    """What a passkey is bound to: the host name, and the origin that the browser must have asked from."""

    rp_id: str
    origin: str


def site_of(settings: Settings, host: str) -> Site:
    """The public address; without one this machine by its name, at the port of a request's `host` header.

    An IP address cannot have passkeys (WebAuthn wants a domain), which is why a server without a public address is
    ``localhost`` and not 127.0.0.1.
    """
    if settings.public_url is not None:
        parts = urlsplit(settings.public_url)
        return Site((parts.hostname or "").lower(), f"{parts.scheme}://{parts.netloc.lower()}")
    name, _, port = host.lower().partition(":")
    if name != LOCAL:
        return Site(LOCAL, f"http://{LOCAL}")
    return Site(LOCAL, f"http://{LOCAL}:{port}" if port else f"http://{LOCAL}")
