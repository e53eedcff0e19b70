"""The bus's keys: whose they are is in them, so that the router's access control can hold it.

    wonderland/agents/<common name>/<issuer>/open/<connection>   an agent's first word
    wonderland/agents/<common name>/<issuer>/up/<connection>     what it sends to the backend that answered
    wonderland/agents/<common name>/<issuer>/down/<answer>       what a backend sends to an agent
    wonderland/serving/<run of a backend>                        a liveliness token: gone when that one is
    wonderland/backends/**                                       what backends say to one another

What agents put under ``open`` and ``up`` only backends may hear: an agent's connection has a random name that no other
agent, of whatever name, ever sees.
"""

from __future__ import annotations

import hashlib
import re
from typing import Final

from wonderland_bus.identity import ISSUER_CHARS, Peer, is_name

AGENTS: Final = "wonderland/agents"
BACKENDS: Final = "wonderland/backends"
"""Backends have every right below it, and agents none."""
SERVING: Final = "wonderland/serving"
ALL_OPENINGS: Final = f"{AGENTS}/*/*/open/*"
CONNECTION_BYTES: Final = 16
_OPENING: Final = re.compile(
    rf"{AGENTS}/([^/]+)/([0-9a-f]{{{ISSUER_CHARS}}})/open/([0-9a-f]{{{2 * CONNECTION_BYTES}}})"
)


def opening(peer: Peer, connection: str) -> str:
    """Where an agent's connection begins."""
    return f"{AGENTS}/{peer.name}/{peer.issuer}/open/{connection}"


def serving(server: int) -> str:
    """The token of a run of a backend."""
    return f"{SERVING}/{server:016x}"


def up(peer: Peer, connection: str) -> str:
    """Where an agent's connection puts what it sends."""
    return f"{AGENTS}/{peer.name}/{peer.issuer}/up/{connection}"


def down(peer: Peer, connection: str) -> str:
    """Where its answers come: whoever sees this key does not know the connection's by it."""
    return f"{AGENTS}/{peer.name}/{peer.issuer}/down/{answer_of(connection)}"


def answer_of(connection: str) -> str:
    """The part of `down`'s key that stands for a connection."""
    return hashlib.sha256(b"wonderland-bus-answer" + connection.encode()).hexdigest()[: 2 * CONNECTION_BYTES]


def parse_opening(key: str) -> tuple[Peer, str] | None:
    """Who begins a connection, as the key has it, and which."""
    found = _OPENING.fullmatch(key)  # which a key expression with a wildcard, that one can put to as well, does not
    if found is None or not is_name(found[1]):
        return None
    return Peer(found[1], found[2]), found[3]
