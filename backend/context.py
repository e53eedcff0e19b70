"""What the parts of a running backend share, handed to endpoints through the application's state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from starlette.requests import HTTPConnection

from backend.auth.sign_ins import SignIns
from backend.db.engine import Database
from backend.ledger.status import MirrorStatus
from backend.settings import Settings

if TYPE_CHECKING:
    import httpx

    from backend.auth.attempts import Attempts
    from backend.clients.machines import Machines
    from backend.clients.store import Clients
    from backend.events.feed import Commits
    from backend.events.streams import Streams
    from backend.ingest.agents import Agents
    from backend.ingest.identity import Members
    from backend.ingest.intake import Intake
    from backend.ledger.access import LedgerAccess
    from backend.live.board import Board
    from backend.live.hub import Hub
    from backend.maps.service import Maps
    from backend.mirror.source import BlockSource
    from backend.transactions.enrolment import Registrar
    from backend.transactions.keys import SigningKeys
    from backend.transactions.service import Signing
    from backend.uspace.service import USpace
    from backend.webhooks.post import Poster
    from wonderland.ledger.proof_contract import ProofContract


@dataclass
class Context:
    """One running backend."""

    settings: Settings
    database: Database
    clock: Callable[[], int]
    """Milliseconds since the Unix epoch."""
    randomness: Callable[[int], bytes]
    sign_ins: SignIns
    attempts: Attempts
    http: httpx.AsyncClient
    """For asking other systems; bounded, without redirects."""
    mirror: MirrorStatus
    board: Board
    hub: Hub
    agents: Agents
    members: Members
    intake: Intake
    uspace: USpace
    clients: Clients
    machines: Machines
    commits: Commits
    """Wakes whoever waits for the next block."""
    streams: Streams
    """Event streams (SSE) that are open."""
    poster: Poster
    maps: Maps
    assets: ProofContract | None
    """The contract as the identity that anchors the audit log; None where there is none."""
    source: BlockSource | None
    """The ledger itself, for what the mirror does not keep."""
    instance: str
    epoch: str
    version: str
    signing_keys: SigningKeys
    ledger: LedgerAccess | None = None
    """For what more is asked of the ledger than its blocks; None where this backend has none."""
    signing: Signing | None = None
    demo_registrar: Registrar | None = None
    """In a demo: gives anybody who is signed in any role on the ledger."""
    allowed_hosts: frozenset[str] = field(default_factory=frozenset)
    """Host names (without port) by which this server may be addressed; empty: any."""

    @property
    def cookie_name(self) -> str:
        """Cookies do not tell ports apart, so that two backends on one host need two names."""
        name = f"wonderland_{self.instance[:8]}"
        return f"__Host-{name}" if self.settings.is_https else name


def context_of(connection: HTTPConnection) -> Context:
    """The context of a request or WebSocket."""
    found = connection.app.state.context
    assert isinstance(found, Context)
    return found
