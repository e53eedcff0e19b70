"""Asking other systems over HTTP: bounded transfers, when to ask again, times as RFC 3339."""
