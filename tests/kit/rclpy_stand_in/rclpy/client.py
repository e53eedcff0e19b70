from __future__ import annotations


class Client:
    """Named in the server's signatures; it calls none."""
