"""All parts of one running backend, and under which type each is found by an endpoint that names it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, get_args, get_type_hints

from wonderland_backend.agents.connected import Agents
from wonderland_backend.agents.members import Members
from wonderland_backend.audit.anchors import AuditIdentity
from wonderland_backend.auth.attempts import Attempts
from wonderland_backend.auth.store.sign_ins import SignIns
from wonderland_backend.clients.machines import Machines
from wonderland_backend.clients.store import Clients
from wonderland_backend.context import Context
from wonderland_backend.errors import Elsewhere
from wonderland_backend.events.queries import Commits
from wonderland_backend.events.streams import Streams
from wonderland_backend.ingest.intake import Intake
from wonderland_backend.ledger.access import LedgerAccess
from wonderland_backend.live.board import Board
from wonderland_backend.live.hub import Hub
from wonderland_backend.maps.service import Maps
from wonderland_backend.metrics import Metrics
from wonderland_backend.mirror.source import BlockSource
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.statements.signed import Statements
from wonderland_backend.transactions.enrolment import DemoRegistrar
from wonderland_backend.transactions.keys import SigningKeys
from wonderland_backend.transactions.service import Signing
from wonderland_backend.uspace.service import USpace
from wonderland_backend.webhooks.post import Poster
from wonderland_backend.webhooks.sealing import Sealing

ON_DUTY: Final = (Agents, Board, Intake, Signing, USpace)
"""Parts that live in the memory of the backend on duty."""


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
    sealing: Sealing
    """Keys of webhooks' secrets."""
    maps: Maps
    metrics: Metrics
    signing_keys: SigningKeys
    audit_identity: AuditIdentity | None
    statements: Statements | None
    """Answers that are signed; None where no identity of this backend may anchor the audit log."""
    source: BlockSource | None
    """The ledger itself, for what the mirror does not keep."""
    ledger: LedgerAccess | None
    """For what more is asked of the ledger than its blocks."""
    signing: Signing | None
    demo_registrar: DemoRegistrar | None
    """In a demo: gives anybody who is signed in any role on the ledger."""

    def by_type(self, context: Context) -> Mapping[type, object]:
        """What `wonderland_backend.context.part_of` looks into."""
        # By the type that a field declares, not by what stands in it: that may be a kind of it, or None.
        declared = {name: (get_args(hint) or (hint,))[0] for name, hint in get_type_hints(Parts).items()}
        return MappingProxyType({Context: context} | {kind: getattr(self, name) for name, kind in declared.items()})

    def of_follower(self, context: Context) -> Mapping[type, object]:
        """The same for a backend that is not on duty."""
        return MappingProxyType({**self.by_type(context), **dict.fromkeys(ON_DUTY, Elsewhere)})
