"""All tables, by who writes them. Whoever needs them all imports this package: the metadata is then complete."""

from wonderland_backend.db.tables import (
    alerts,
    audit,
    clients,
    exports,
    flights,
    ledger,
    numbers,
    people,
    proof_requests,
    reported,
    signing,
    site_plans,
    webhooks,
    zones,
)
from wonderland_backend.db.tables.base import Base

__all__ = [
    "Base",
    "alerts",
    "audit",
    "clients",
    "exports",
    "flights",
    "ledger",
    "numbers",
    "people",
    "proof_requests",
    "reported",
    "signing",
    "site_plans",
    "webhooks",
    "zones",
]
