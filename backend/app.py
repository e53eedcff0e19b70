"""The application: its parts put together, started and stopped in order."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any, Final

from fastapi import APIRouter, FastAPI
from fastapi.openapi.utils import get_openapi
from fastapi.routing import APIRoute
from pydantic.json_schema import models_json_schema
from sqlalchemy import insert, select

from backend import console, errors
from backend.alerts import endpoints as alerts
from backend.alerts.deliver import Delivery
from backend.alerts.service import Alerts
from backend.alerts.watch import Watch
from backend.auth import endpoints as auth
from backend.auth.sign_ins import SignIns
from backend.boundary import Boundary
from backend.context import Context
from backend.db.engine import Database
from backend.db.models import InstanceRow, OrganisationRow
from backend.drones import endpoints as drones
from backend.ingest import endpoints as ingest
from backend.ingest.agents import Agents
from backend.ingest.identity import Members
from backend.ingest.intake import Intake
from backend.ledger import endpoints as ledger
from backend.ledger.status import MirrorStatus
from backend.live import endpoints as live
from backend.live.board import Board
from backend.live.hub import Hub
from backend.live.schemas import FRAMES
from backend.mirror.derive import Changes
from backend.mirror.follow import Mirror
from backend.mirror.source import BlockSource
from backend.pads import endpoints as pads
from backend.search import endpoints as search
from backend.sessions import endpoints as sessions
from backend.settings import Settings
from backend.statistics import endpoints as statistics
from backend.tracks import endpoints as tracks
from backend.tracks import queries as track_queries
from backend.verdicts import endpoints as verdicts
from wonderland import __version__

logger = logging.getLogger(__name__)

API: Final = "/api/v1"
TIDY_EVERY_S: Final = 300.0
CHECK_EVERY_S: Final = 15.0
DESCRIPTION: Final = """\
What Wonderland knows: pads, drones, proofs of location and their verdicts, as the ledger has them; and beside them,
marked unverified, what drones broadcast and what pads measure while a proof is under way.

Times are milliseconds since the Unix epoch (`_ms`), positions WGS-84 degrees × 10⁷ (`_e7`), lengths millimetres
(`_mm`). Lists are paged by cursor. Errors are problem details (RFC 9457). Live changes come over the WebSocket
`/api/v1/live?since=<epoch>:<seq>`, whose frames are the schemas LiveHello, LiveSnapshot and LiveDelta.
"""


def now_ms() -> int:
    """Milliseconds since the Unix epoch."""
    return time.time_ns() // 1_000_000


class Backend:
    """One backend: `start`, then serve `app`, then `stop`."""

    def __init__(
        self,
        settings: Settings,
        *,
        database: Database,
        source: BlockSource | None = None,
        channel: str = "",
        chaincode: str = "",
        ledger_kind: str = "unknown",
        ledger_notice: str = "",
        allowed_hosts: frozenset[str] = frozenset(),
        clock: Callable[[], int] = now_ms,
        randomness: Callable[[int], bytes] = secrets.token_bytes,
        console_directory: Path | None = None,
    ) -> None:
        self.settings = settings
        self.database = database
        self._tasks: list[asyncio.Task[None]] = []
        epoch = randomness(8).hex()
        status = MirrorStatus(kind=ledger_kind, notice=ledger_notice, channel=channel)
        agents = Agents()
        board = Board(mirror=status, agents=agents, clock=clock, version=__version__, epoch=epoch, demo=settings.demo)
        agents.on_change = board.connection_changed
        self.context = Context(
            settings=settings,
            database=database,
            clock=clock,
            randomness=randomness,
            sign_ins=SignIns(database, settings, clock, randomness),
            mirror=status,
            board=board,
            hub=Hub(
                board,
                epoch=epoch,
                clock=clock,
                tick_ms=settings.tick_ms,
                ring_bytes=settings.ring_bytes,
                client_queue_bytes=settings.client_queue_bytes,
                max_viewers=settings.max_viewers,
            ),
            agents=agents,
            members=Members(),
            intake=Intake(database, board, clock),
            source=source,
            instance="",
            epoch=epoch,
            version=__version__,
        )
        self._alerts = Alerts(settings, board, clock)
        self.watch = Watch(self.context)
        self._mirror = (
            Mirror(
                database,
                source,
                channel=channel,
                chaincode=chaincode,
                status=status,
                clock=clock,
                on_changes=self._committed,
                also=self._alerts.in_transaction,
                batch_transactions=settings.mirror_batch_transactions,
            )
            if source is not None
            else None
        )
        self.app = new_app(settings, allowed_hosts, console_directory)
        self.app.state.context = self.context

    async def start(self) -> None:
        """Fill the board from the (migrated) database and start the parts that run by themselves."""
        self.context.instance = await _instance(self.database, self.context)
        async with self.database.read() as session:
            await self.context.board.load(session)
            organisations = (await session.execute(select(OrganisationRow.msp_id, OrganisationRow.definition))).all()
        self.context.members.configure((msp_id, definition) for msp_id, definition in organisations)
        self.context.mirror.level_ms = self.context.clock()
        self._run(self.context.intake.run(), "intake")
        self._run(self.context.hub.run(), "hub")
        self._run(self._tidy(), "tidy")
        self._run(self._check(), "check")
        if self._mirror is not None:
            self._run(self._mirror.run(), "mirror")
            self._run(self.watch.run(), "watch")
        if self.settings.alert_emails or self.settings.alert_webhooks:
            self._run(Delivery(self.database, self.settings, self.context.clock).run(), "delivery")

    async def stop(self) -> None:
        """Close live connections, stop the parts, close the database."""
        self.context.hub.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._tasks.clear()
        await self.database.close()

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[Backend]:
        """Started inside, stopped after."""
        try:
            await self.start()
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
                self.context.mirror.halted = f"The mirror ended by an unexpected error: {type(error).__name__}: {error}"

    def _committed(self, changes: Changes) -> None:
        if changes.organisations is not None:
            self.context.members.configure((row["msp_id"], row["definition"]) for row in changes.organisations)
            self._dismiss()
        self.context.board.commit(changes)
        self._alerts.committed()

    def _dismiss(self) -> None:
        now = self.context.clock()
        self.context.agents.dismiss(lambda msp_id, creator: self.context.members.is_member(msp_id, creator, now))

    async def _tidy(self) -> None:
        keep_ms = int(self.settings.track_retention_h * 3_600_000)
        while True:
            try:
                async with self.database.write() as connection:
                    await track_queries.forget(connection, self.context.clock() - keep_ms)
            except Exception:
                logger.exception("old positions could not be deleted; trying again later")
            await asyncio.sleep(TIDY_EVERY_S)

    async def _check(self) -> None:
        """Live connections end with the sign-in that opened them, agents' with their certificate."""
        while True:
            await asyncio.sleep(CHECK_EVERY_S)
            self._dismiss()
            for person in self.context.hub.people():
                try:
                    found = await self.context.sign_ins.find_by_hash(person)
                except Exception:
                    logger.exception("a sign-in could not be checked; trying again later")
                    break
                if found is None:
                    self.context.hub.close_person(person)


def new_app(settings: Settings, allowed_hosts: frozenset[str], console_directory: Path | None) -> FastAPI:
    """The routes; what they work on is in ``app.state.context``."""
    app = FastAPI(
        title="Wonderland",
        version=__version__,
        description=DESCRIPTION,
        openapi_url=f"{API}/openapi.json",
        docs_url=None,
        redoc_url=None,
        separate_input_output_schemas=False,
        generate_unique_id_function=_operation_id,
        redirect_slashes=False,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
    )
    api = APIRouter(prefix=API)
    for router in (
        auth.router,
        ledger.public,
        ledger.router,
        pads.router,
        drones.router,
        sessions.router,
        verdicts.router,
        tracks.router,
        alerts.router,
        search.router,
        statistics.router,
        live.router,
    ):
        api.include_router(router)
    app.include_router(api)
    app.include_router(ingest.router)
    errors.install(app)

    async def unknown() -> None:
        raise errors.NotFound("There is nothing at this address; see /api/v1/openapi.json for what there is.")

    app.add_api_route("/api/{path:path}", unknown, methods=["GET", "HEAD"], include_in_schema=False)
    console.install(app, console.find(console_directory))
    app.add_middleware(
        Boundary, allowed_hosts=allowed_hosts, max_body_bytes=settings.max_body_bytes, https=settings.is_https
    )
    app.openapi = lambda: openapi(app)  # type: ignore[method-assign]
    return app


def openapi(app: FastAPI) -> dict[str, Any]:
    """The interface's description, with the live frames' schemas; the same bytes each time."""
    if app.openapi_schema is None:
        document = get_openapi(
            title=app.title,
            version=app.version,
            description=app.description,
            routes=app.routes,
            license_info=app.license_info,
            separate_input_output_schemas=False,
        )
        schemas = document["components"]["schemas"]
        _, frames = models_json_schema(
            [(frame, "validation") for frame in FRAMES], ref_template="#/components/schemas/{model}"
        )
        for name, schema in frames["$defs"].items():
            schemas.setdefault(name, schema)
        for unused in ("HTTPValidationError", "ValidationError"):
            schemas.pop(unused, None)
        schemas.setdefault("ProblemDetails", _problem_schema(schemas))
        _refusals(document)
        document["components"]["schemas"] = dict(sorted(schemas.items()))
        app.openapi_schema = document
    return app.openapi_schema


def _problem_schema(schemas: dict[str, Any]) -> dict[str, Any]:
    schema = errors.ProblemDetails.model_json_schema(ref_template="#/components/schemas/{model}")
    for name, definition in schema.pop("$defs", {}).items():
        schemas.setdefault(name, definition)
    return schema


def _refusals(document: dict[str, Any]) -> None:
    """Validation errors are problems, too."""
    reference = {"schema": {"$ref": "#/components/schemas/ProblemDetails"}}
    for operations in document["paths"].values():
        for operation in operations.values():
            refused = operation.get("responses", {}).get("422")
            if refused is not None:
                refused["description"] = "A parameter or field that is not allowed."
                refused["content"] = {errors.MEDIA_TYPE: reference}


def _operation_id(route: APIRoute) -> str:
    return route.name


async def _instance(database: Database, context: Context) -> str:
    async with database.write() as connection:
        known = (await connection.execute(select(InstanceRow.instance))).scalar_one_or_none()
        if known is not None:
            return str(known)
        instance = context.randomness(16).hex()
        row = {"id": 1, "instance": instance, "created_ms": context.clock()}
        await connection.execute(insert(InstanceRow), [row])
        return instance
