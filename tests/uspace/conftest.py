"""An authority that issues tokens, a DSS, and backends that trust the authority."""

from __future__ import annotations

from kit.uspace import _served, _track, authority, clock, dss, keys, new_uss, until

__all__ = ["_served", "_track", "authority", "clock", "dss", "keys", "new_uss", "until"]
