"""The application: its parts put together, started and stopped in order."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import orjson

from wonderland import __version__
from wonderland_backend.agents.connected import Agents
from wonderland_backend.agents.listener import EndPoints
from wonderland_backend.agents.members import Members
from wonderland_backend.agents.standing import Standing
from wonderland_backend.alerts.deliver import Delivery
from wonderland_backend.alerts.service import Alerts
from wonderland_backend.alerts.watch import Watch
from wonderland_backend.audit.anchors import Anchoring, AuditIdentity
from wonderland_backend.audit.queries import bus_key
from wonderland_backend.audit.queries import instance as instance_of
from wonderland_backend.audit.store import ensure_bus_key, ensure_instance
from wonderland_backend.audit.stream import AuditStream, destination_of
from wonderland_backend.auth.attempts import Attempts
from wonderland_backend.auth.store.sign_ins import SignIns
from wonderland_backend.clients.machines import machines_of
from wonderland_backend.clients.store import Clients
from wonderland_backend.context import Context
from wonderland_backend.db.engine import Database
from wonderland_backend.db.partitions import make_ahead
from wonderland_backend.events.queries import Commits
from wonderland_backend.events.streams import Streams
from wonderland_backend.flights.store import forget as forget_flights
from wonderland_backend.http.times import now_ms
from wonderland_backend.http.transfer import new_client
from wonderland_backend.ingest.bus_ingest import bus_ingest
from wonderland_backend.ingest.intake import Intake
from wonderland_backend.ingest.serving import Ingest
from wonderland_backend.ledger.access import LedgerAccess
from wonderland_backend.live.aside import Aside
from wonderland_backend.live.board import Board
from wonderland_backend.live.copy import BoardCopy
from wonderland_backend.live.hub import Hub
from wonderland_backend.maps.service import Maps
from wonderland_backend.metrics import Metrics
from wonderland_backend.mirror.follow import Mirror
from wonderland_backend.mirror.row_check import RowCheck
from wonderland_backend.mirror.rows import participants
from wonderland_backend.mirror.source import BlockSource
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.mirror.subscriber import AfterCommit
from wonderland_backend.mirror.verified import VerifiedSource
from wonderland_backend.outputs.mqtt import MqttOutput
from wonderland_backend.parts import Parts
from wonderland_backend.registry.queries.organisations import definitions
from wonderland_backend.replay.store import Arrivals, Connections, note_unknown
from wonderland_backend.replicas.follower import Follower
from wonderland_backend.replicas.on_duty import OnDuty
from wonderland_backend.replicas.sealed import KEY_BYTES
from wonderland_backend.routes import new_app
from wonderland_backend.settings import Settings
from wonderland_backend.statements.signed import Statements
from wonderland_backend.tracks import queries as track_queries
from wonderland_backend.transactions.enrolment import DemoRegistrar, Registrar
from wonderland_backend.transactions.keys import SigningKeys
from wonderland_backend.transactions.service import SWEEP_AFTER_MS, Signing
from wonderland_backend.transactions.store import sweep as sweep_numbers
from wonderland_backend.uspace.service import USpace
from wonderland_backend.webhooks.deliver import Webhooks
from wonderland_backend.webhooks.post import poster_of
from wonderland_backend.webhooks.sealing import Sealing

if TYPE_CHECKING:
    from wonderland_backend.replicas.bus import Bus

logger = logging.getLogger(__name__)

TIDY_EVERY_S: Final = 300.0
CHECK_EVERY_S: Final = 15.0


class Backend:
    """One backend: `start`, then serve `app`, then `stop`."""

    def __init__(
        self,
        settings: Settings,
        *,
        database: Database,
        source: BlockSource | None = None,
        audit_identity: AuditIdentity | None = None,
        ledger: LedgerAccess | None = None,
        demo_registrar: Registrar | None = None,
        channel: str = "",
        chaincode: str = "",
        ledger_kind: str = "unknown",
        ledger_notice: str = "",
        allowed_hosts: frozenset[str] = frozenset(),
        clock: Callable[[], int] = now_ms,
        randomness: Callable[[int], bytes] = secrets.token_bytes,
        epoch: str | None = None,
        peers: Bus | None = None,
        console_directory: Path | None = None,
    ) -> None:
        self.settings = settings
        self.database = database
        self._tasks: list[asyncio.Task[None]] = []
        self._peers = peers
        self._following: asyncio.Task[None] | None = None
        uspace = USpace(settings, clock)
        clients = Clients(database, clock, randomness)
        http = new_client()
        epoch = epoch or randomness(8).hex()
        status = MirrorStatus(kind=ledger_kind, notice=ledger_notice, channel=channel)
        agents = Agents()
        members = Members(EndPoints.of(settings))
        board = Board(mirror=status, agents=agents, clock=clock, version=__version__, epoch=epoch, demo=settings.demo)
        self._connections = Connections(database, epoch, clock)
        agents.on_change = self._connection_changed
        hub = Hub(
            board,
            epoch=epoch,
            clock=clock,
            tick_ms=settings.tick_ms,
            ring_bytes=settings.ring_bytes,
            client_queue_bytes=settings.client_queue_bytes,
            max_viewers=settings.max_viewers,
        )
        intake = Intake(database, board, clock)
        self.context = Context(settings, database, clock, randomness, http, epoch, __version__)
        self.parts = Parts(
            sign_ins=SignIns(database, settings, clock, randomness),
            attempts=Attempts(settings.sign_in_attempts),
            mirror=status,
            board=board,
            hub=hub,
            agents=agents,
            members=members,
            intake=intake,
            uspace=uspace,
            clients=clients,
            machines=machines_of(settings, clients, uspace.verifier, uspace.host, clock, randomness),
            commits=Commits(),
            streams=Streams(settings.max_event_streams, settings.max_event_streams_each),
            sealing=Sealing.load(settings.webhook_key_file, database, randomness),
            poster=poster_of(settings),
            maps=Maps(settings.map, http),
            metrics=Metrics(status, hub, agents, intake, uspace, clock, lambda: self.app.state.follower is None),
            signing_keys=SigningKeys(database, members, clock),
            audit_identity=audit_identity,
            statements=None
            if audit_identity is None
            else Statements(audit_identity.identity, audit_identity.signer, channel, members.authorities),
            source=source,
            ledger=ledger,
            signing=Signing(database, ledger, clock, per_minute=settings.signed_per_minute, alone=settings.demo)
            if ledger
            else None,
            demo_registrar=DemoRegistrar(demo_registrar) if demo_registrar else None,
        )
        self.bus = bus_ingest(settings.bus, Ingest(self.context, members, agents, intake), self.parts.sign_ins)
        self.standing = Standing(agents, members, clock)
        self.watch = Watch(self.context, status, agents, board.alert)
        self._mirror = (
            Mirror(
                database,
                source,
                channel=channel,
                chaincode=chaincode,
                status=status,
                clock=clock,
                subscribers=(
                    Arrivals(clock),
                    AfterCommit(self.standing.committed),
                    AfterCommit(board.commit),
                    Alerts(settings, board.alert, clock),
                    AfterCommit(lambda _changes: self.parts.commits.pulse()),
                ),
                batch_transactions=settings.mirror_batch_transactions,
            )
            if source is not None
            else None
        )
        self.row_check = (
            RowCheck(
                database,
                source.plain if isinstance(source, VerifiedSource) else source,  # equal to blocks that were checked
                channel=channel,
                chaincode=chaincode,
                status=status,
                clock=clock,
                transactions_per_s=settings.row_check_transactions_per_s,
            )
            if source is not None and settings.row_check_transactions_per_s
            else None
        )
        self.app = new_app(settings, allowed_hosts, console_directory)
        self.app.state.parts = self.parts.by_type(self.context)
        self.app.state.follower = None

    async def start(self) -> None:
        """Fill the board from the (migrated) database and start the parts that run by themselves."""
        async with self.database.write() as connection:
            name = self.context.randomness(16).hex()
            self.context.instance = await ensure_instance(connection, name, self.context.clock())
        await asyncio.to_thread(self.parts.maps.check)
        self._run(self._check(), "check")
        await self.take_duty()

    async def follow(self, holder: Callable[[], Awaitable[str]]) -> None:
        """Show what another backend shows, which is on duty, and pass on to it what only it can do.

        `holder`: the epoch of whoever is on duty. Needs a bus, and a database that another backend has made.
        """
        assert self._peers is not None
        async with self.database.read() as session:
            self.context.instance = await instance_of(session) or ""
            self._peers.use(bytes.fromhex(await bus_key(session) or ""))
            await self.parts.board.load(session)
        await asyncio.to_thread(self.parts.maps.check)
        copy = BoardCopy(self.context.clock)
        # Until the one on duty is heard, what the database says, and that it may be old.
        copy.stale_since_ms = self.context.clock()
        board = self.parts.board
        copy.replace([orjson.dumps({**board.snapshot(), "status": board.status()})], board.owners())
        self.parts.hub.begin("", 0, copy)
        self.app.state.parts = self.parts.of_follower(self.context)
        follower = Follower(
            self._peers,
            self.context.instance,
            self.parts.hub,
            copy,
            holder=holder,
            noted=self._noted,
            clock=self.context.clock,
        )
        await self._noted({}, Aside(organisations=True))
        self.app.state.follower = follower
        await follower.begin()
        self._following = asyncio.create_task(follower.run(), name="follower")
        self._run(self._check(), "check")

    async def _noted(self, content: dict[str, Any], aside: Aside) -> None:
        """What else changes here by a frame of the backend on duty."""
        if (status := content.get("status")) is not None:
            self.parts.mirror.show(status["ledger"], self.context.clock())
        if aside.organisations:
            async with self.database.read() as session:
                self.parts.members.configure(await definitions(session))
        if aside.committed:
            self.parts.commits.pulse()

    async def take_duty(self) -> None:
        """Be the one that mirrors, takes in what agents report, and raises alerts; the database's lock is held."""
        if self._following is not None:
            self._following.cancel()
            await asyncio.gather(self._following, return_exceptions=True)
            self._following = None
        self.parts.mirror.begin(self.context.clock())
        await self.parts.sealing.seal_all(self.database)
        async with self.database.read() as session:
            await self.parts.board.load(session)
            organisations = await definitions(session)
        self.parts.members.configure(organisations)
        self.parts.mirror.organisations = participants(organisations)
        self.parts.mirror.level_ms = self.context.clock()
        self.parts.hub.begin(self.context.epoch, 0, self.parts.board)
        self.app.state.parts = self.parts.by_type(self.context)
        self.app.state.follower = None
        if self._peers is not None:
            self._peers.silence()
            async with self.database.write() as connection:
                new = self.context.randomness(KEY_BYTES).hex()
                self._peers.use(bytes.fromhex(await ensure_bus_key(connection, new)))
            on_duty = OnDuty(self._peers, self.context.instance, self.parts.hub, self.parts.board, self.app)
            self._run(on_duty.run(), "on duty")
        async with self.database.write() as connection:
            await make_ahead(connection, self.context.clock())
            await note_unknown(connection)
        self._run(self.parts.intake.run(), "intake")
        self.parts.uspace.attach(self.parts.intake, self.parts.agents, self.database)
        self._run(self.parts.uspace.run(self.context.instance), "uspace")
        self._run(self._connections.run(), "connections")
        self._run(self.parts.hub.run(), "hub")
        self._run(self._tidy(), "tidy")
        if self.parts.audit_identity is not None:
            anchors = self.parts.audit_identity.anchors(self.context.instance)
            every_s = self.settings.audit_anchor_s
            anchoring = Anchoring(self.database, anchors, every_s=every_s, clock=self.context.clock)
            self._run(anchoring.run(), "audit")
        if (stream := self.settings.audit_stream) is not None:
            destination = destination_of(stream, self.context.instance)
            self._run(AuditStream(self.database, destination, stream.to, self.context.clock).run(), "audit stream")
        if self.bus is not None:
            self._run(self.bus.listener.run(), "bus")
        told = Webhooks(self.database, self.parts.poster, self.parts.sealing, self.parts.commits, self.context.clock)
        self._run(told.run(), "webhooks")
        if self.parts.signing is not None:
            await self.parts.signing.resume()
        if self._mirror is not None:
            self._run(self._mirror.run(), "mirror")
            self._run(self.watch.run(), "watch")
        if self.row_check is not None:
            self._run(self.row_check.run(), "row check")
        if (mqtt := self.settings.outputs.mqtt) is not None:
            self._run(MqttOutput(mqtt, self.parts.hub, self.context.instance).run(), "mqtt")
        if (tak := self.settings.outputs.tak) is not None:
            from wonderland_backend.outputs.tak import TakOutput  # noqa: PLC0415 - pytak brings much along

            self._run(TakOutput(tak, self.parts.hub, self.context.clock).run(), "tak")
        if self.settings.alert_emails or self.settings.alert_webhooks:
            self._run(Delivery(self.database, self.settings, self.context.clock).run(), "delivery")

    async def stop(self) -> None:
        """Close live connections, stop the parts, close the database."""
        self.end_streams()
        if self._following is not None:
            self._tasks.append(self._following)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._tasks.clear()
        if self.parts.signing is not None:
            await self.parts.signing.stop()
        await self.parts.uspace.close()
        await self.parts.poster.close()
        await self.context.http.aclose()
        await self.database.close()

    def end_streams(self) -> None:
        """End what would last as long as the server: live connections, event streams."""
        self.parts.hub.close()
        self.parts.commits.stop()

    @contextlib.asynccontextmanager
    async def running(self, behind: Callable[[], Awaitable[str]] | None = None) -> AsyncIterator[Backend]:
        """Started inside, stopped after. `behind`: the epoch of whoever is on duty instead of this one."""
        try:
            await (self.start() if behind is None else self.follow(behind))
            yield self
        finally:
            await self.stop()

    def _run(self, work: Any, name: str) -> None:
        task: asyncio.Task[None] = asyncio.create_task(work, name=name)
        task.add_done_callback(self._ended)
        self._tasks.append(task)

    def _ended(self, task: asyncio.Task[None]) -> None:
        if task.cancelled():
            return
        error = task.exception()
        if error is not None:
            logger.critical("%s ended by an unexpected error", task.get_name(), exc_info=error)
            if task.get_name() == "mirror":
                why = f"The mirror ended by an unexpected error: {type(error).__name__}: {error}"
                self.parts.mirror.halt(self.context.clock(), why)

    def _connection_changed(self, pad_id: str) -> None:
        self.parts.board.connection_changed(pad_id)
        self._connections.changed(pad_id, connected=self.parts.agents.is_connected(pad_id))

    async def _tidy(self) -> None:
        while True:
            try:
                async with self.database.write() as connection:
                    await make_ahead(connection, self.context.clock())
                    keep_ms = int(self.settings.track_retention_h * 3_600_000)
                    await forget_flights(connection, self.context.clock() - keep_ms)
                    await track_queries.forget(connection, track_queries.kept(self.settings, self.context.clock()))
                    await sweep_numbers(connection, self.context.clock() - SWEEP_AFTER_MS)
            except Exception:
                logger.exception("old positions could not be deleted; trying again later")
            await asyncio.sleep(TIDY_EVERY_S)

    async def _check(self) -> None:
        """Live connections end with the sign-in or token that opened them, agents' with their certificate."""
        while True:
            await asyncio.sleep(CHECK_EVERY_S)
            self.standing.check()
            for person in self.parts.hub.people():
                try:
                    stays = await self._stays(person)
                except Exception:
                    logger.exception("a sign-in could not be checked; trying again later")
                    break
                if not stays:
                    self.parts.hub.close_person(person)

    async def _stays(self, person: str) -> bool:
        """Whether a live connection's sign-in or token (`live.endpoints` names it) is still good."""
        if ":" in person:
            machine, role, expires_ms = person.split(":")
            return await self.parts.machines.may_go_on(machine, role, int(expires_ms), self.context.clock())
        return await self.parts.sign_ins.find_by_hash(person) is not None
