"""Addresses of other systems, as settings and their messages name them."""

from __future__ import annotations

from typing import Final

ADDRESS: Final = r"https?://[^/\s@?#]+(/[^\s@?#]*)?"
"""HTTP or HTTPS, without user, query and fragment; a pattern without its anchors."""
