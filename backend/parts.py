"""All parts of one running backend, and under which type each is found by an endpoint that names it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import get_args, get_type_hints

from backend.auth.attempts import Attempts
from backend.auth.sign_ins import SignIns
from backend.clients.machines import Machines
from backend.clients.store import Clients
from backend.context import Context
from backend.events.feed import Commits
from backend.events.streams import Streams
from backend.ingest.agents import Agents
from backend.ingest.identity import Members
from backend.ingest.intake import Intake
from backend.ledger.access import LedgerAccess
from backend.ledger.status import MirrorStatus
from backend.live.board import Board
from backend.live.hub import Hub
from backend.maps.service import Maps
from backend.metrics import Metrics
from backend.mirror.source import BlockSource
from backend.transactions.enrolment import DemoRegistrar
from backend.transactions.keys import SigningKeys
from backend.transactions.service import Signing
from backend.uspace.service import USpace
from backend.webhooks.post import Poster
from wonderland.ledger.proof_contract import ProofContract


@dataclass(frozen=True)
class Parts:
    """One of each; None where this backend has none."""

    sign_ins: SignIns
    attempts: Attempts
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
    metrics: Metrics
    signing_keys: SigningKeys
    assets: ProofContract | None
    """The contract as the identity that anchors the audit log."""
    source: BlockSource | None
    """The ledger itself, for what the mirror does not keep."""
    ledger: LedgerAccess | None
    """For what more is asked of the ledger than its blocks."""
    signing: Signing | None
    demo_registrar: DemoRegistrar | None
    """In a demo: gives anybody who is signed in any role on the ledger."""

    def by_type(self, context: Context) -> Mapping[type, object]:
        """What `backend.context.part_of` looks into."""
        # By the type that a field declares, not by what stands in it: that may be a kind of it, or None.
        declared = {name: (get_args(hint) or (hint,))[0] for name, hint in get_type_hints(Parts).items()}
        return MappingProxyType({Context: context} | {kind: getattr(self, name) for name, kind in declared.items()})
