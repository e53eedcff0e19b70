"""Which scope opens which part of the API to machines. What is not named here is closed to them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

PADS: Final = "wonderland.pads.read"
DRONES: Final = "wonderland.drones.read"
PROOFS: Final = "wonderland.proofs.read"
REQUEST: Final = "wonderland.proofs.request"
TRACKS: Final = "wonderland.tracks.read"
ALERTS: Final = "wonderland.alerts.read"
LEDGER: Final = "wonderland.ledger.read"
ZONES: Final = "wonderland.zones.read"
EXPORTS: Final = "wonderland.exports"
SUBSCRIPTIONS: Final = "wonderland.subscriptions"
TRAFFIC: Final = "wonderland.traffic."
RID_DISPLAY: Final = "rid.display_provider"
RID_SERVICE: Final = "rid.service_provider"

SCOPES: Final[Mapping[str, str]] = {
    PADS: "Landing pads, their anchors and their health",
    DRONES: "Drones and authorisations",
    PROOFS: "Sessions, proofs and verdicts, conformance of broadcasts, their events",
    REQUEST: "Ask that a drone proves its location at a pad",
    TRACKS: "What drones broadcast: positions, flights, oddities",
    ALERTS: "Alerts",
    LEDGER: "Blocks, transactions, status",
    ZONES: "Zones (ED-318) and where they hold",
    EXPORTS: "Windows of the past as files: GeoJSON, CSV, OGC Moving Features JSON",
    SUBSCRIPTIONS: "Webhooks of one's own",
    f"{TRAFFIC}authority": "Traffic (EU 2021/664) as the competent authority gets it",
    f"{TRAFFIC}ats": "Traffic as air traffic services get it",
    f"{TRAFFIC}ussp": "Traffic as U-space service providers get it",
    f"{TRAFFIC}public": "Traffic as the public gets it, without identities",
    RID_DISPLAY: "ASTM F3411-22a: a display provider",
    RID_SERVICE: "ASTM F3411-22a: a service provider",
}
"""Every scope that a client may be given, and what it is for."""

NAMING: Final = frozenset(f"{TRAFFIC}{recipient}" for recipient in ("authority", "ats", "ussp"))
"""These name operators and pilots: a machine has them as long as its person is of the authority."""
LIVE: Final = (PADS, PROOFS, TRACKS, ALERTS)
"""All of these open the live WebSocket, whose frames have all of it."""

_READ: Final[Mapping[str, frozenset[str]]] = {
    "pads": frozenset({PADS}),
    "drones": frozenset({DRONES}),
    "authorisations": frozenset({DRONES}),
    "sessions": frozenset({PROOFS}),
    "verdicts": frozenset({PROOFS}),
    "proofs": frozenset({PROOFS}),
    "conformance": frozenset({PROOFS, RID_DISPLAY}),
    "events": frozenset({PROOFS}),
    "proof requests": frozenset({PROOFS, REQUEST}),
    "tracks": frozenset({TRACKS}),
    "flights": frozenset({TRACKS}),
    "picture": frozenset({TRACKS, PROOFS}),
    "alerts": frozenset({ALERTS}),
    "ledger": frozenset({LEDGER}),
    "traffic": frozenset(f"{TRAFFIC}{recipient}" for recipient in ("authority", "ats", "ussp", "public")),
    "zones": frozenset({ZONES}),
    "exports": frozenset({EXPORTS}),
    "geo-awareness": frozenset({ZONES}),
    "subscriptions": frozenset({SUBSCRIPTIONS}),
}
_WRITE: Final[Mapping[str, frozenset[str]]] = {
    "exports": frozenset({EXPORTS}),
    "geo-awareness": frozenset({ZONES}),
    "proof requests": frozenset({REQUEST}),
    "subscriptions": frozenset({SUBSCRIPTIONS}),
}
_SAFE: Final = frozenset({"GET", "HEAD"})
_NONE: Final[frozenset[str]] = frozenset()


def scopes_for(method: str, tag: str) -> frozenset[str]:
    """Each of these scopes opens an operation with this tag to machines; none: nothing does."""
    return (_READ if method.upper() in _SAFE else _WRITE).get(tag, _NONE)
