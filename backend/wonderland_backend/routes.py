"""The application's routes, by domain, and what stands before all of them."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from fastapi import APIRouter, FastAPI, Request
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from starlette.exceptions import HTTPException
from starlette.middleware.gzip import DEFAULT_EXCLUDED_CONTENT_TYPES, GZipMiddleware

from wonderland import __version__
from wonderland.problems import said
from wonderland.registry import lists
from wonderland.site_plans import MAX_BYTES
from wonderland_backend import console, errors
from wonderland_backend.answer_headers import AnswerHeaders
from wonderland_backend.audit.refusals import RefusalLog
from wonderland_backend.auth.gate import SetUpGate
from wonderland_backend.boundary import Boundary
from wonderland_backend.description import DESCRIPTION, openapi
from wonderland_backend.ingest import endpoints as ingest
from wonderland_backend.live import endpoints as live
from wonderland_backend.outputs import endpoints as outputs
from wonderland_backend.reference import asyncapi, problems
from wonderland_backend.reference import page as reference
from wonderland_backend.reference import webhooks as described_webhooks
from wonderland_backend.replicas.pass_on import PassOn
from wonderland_backend.rest import (
    alerts,
    audit,
    authorisations,
    clients,
    conformance,
    drones,
    events,
    exports,
    flights,
    ledger,
    maps,
    me,
    oidc,
    pads,
    people,
    proof_requests,
    proofs,
    registry,
    replay,
    search,
    sessions,
    sign_in,
    sign_in_methods,
    site_plans,
    statistics,
    step_up,
    tracks,
    transactions,
    verdicts,
    webhooks,
    zones,
)
from wonderland_backend.settings import Settings
from wonderland_backend.uspace.endpoints import geo_awareness, networked_flights, remote_id, remote_id_tests, traffic

API: Final = "/api/v1"
AS_THEY_ARE: Final = (*DEFAULT_EXCLUDED_CONTENT_TYPES, maps.BYTES)
"""Kinds of content that are not compressed: those that are already, streams, and parts of files."""
MACHINES: Final = ("/api", "/oauth", "/.well-known", "/uss", "/metrics", "/health", "/ingest")
"""At and below these no page of the console is."""


def new_app(settings: Settings, allowed_hosts: frozenset[str], console_directory: Path | None) -> FastAPI:
    """The routes; what they work on is in ``app.state.parts``."""
    app = FastAPI(
        title="Wonderland",
        version=__version__,
        description=DESCRIPTION,
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        separate_input_output_schemas=False,
        generate_unique_id_function=_operation_id,
        redirect_slashes=False,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
    )
    api = APIRouter(prefix=API)
    for router in (
        sign_in.router,
        sign_in_methods.router,
        step_up.router,
        oidc.router,
        me.router,
        people.router,
        audit.router,
        transactions.router,
        registry.router,
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
        replay.router,
        exports.router,
        authorisations.router,
        proofs.router,
        conformance.router,
        proof_requests.router,
        flights.router,
        events.router,
        webhooks.router,
        zones.router,
        zones.service,
        maps.router,
        site_plans.router,
        clients.router,
        reference.router,
        problems.router,
        asyncapi.router,
        live.router,
        outputs.router,
        traffic.router,
        networked_flights.router,
    ):
        api.include_router(router)
    app.include_router(api)
    app.include_router(ingest.router)
    app.include_router(remote_id.router)
    app.include_router(clients.oauth)
    errors.install(app)
    described_webhooks.describe(app.webhooks)

    app.add_api_route(f"{API}/openapi.json", _description, methods=["GET"], include_in_schema=False)
    for start in MACHINES:
        for path in (start, f"{start}/{{path:path}}"):
            app.add_api_route(path, _unknown, methods=["GET"], include_in_schema=False, name=errors.NOTHING)
    if settings.uspace.test_harness:
        app.include_router(remote_id_tests.router)
        app.include_router(geo_awareness.router)
    for path in (*remote_id_tests.PATHS, *geo_awareness.PATHS):
        methods = ["GET", "PUT", "POST", "DELETE"]
        app.add_api_route(path, _unknown, methods=methods, include_in_schema=False, name=errors.NOTHING)
    console.install(app, console.find_console(console_directory))
    # No answer has a secret beside words of whoever asks, from whose length one could be guessed (BREACH).
    app.add_middleware(GZipMiddleware, minimum_size=1024, compresslevel=5, exclude_content_types=AS_THEY_ARE)
    app.add_middleware(AnswerHeaders)
    app.add_middleware(SetUpGate)
    app.add_middleware(PassOn)
    app.add_middleware(
        Boundary,
        allowed_hosts=allowed_hosts,
        max_body_bytes=_largest_body(settings),
        https=settings.is_https,
        larger={
            f"{API}/registry/imports/": lists.MAX_BYTES,
            f"{API}/zones/imports": settings.max_zone_file_bytes,
            f"{API}/site-plans/": MAX_BYTES,
        },
    )
    app.add_middleware(RefusalLog)  # the outermost: what the boundary refuses is written down, too
    app.openapi = lambda: openapi(app)  # type: ignore[method-assign]
    return app


# FastAPI remembers the functions behind routes for ever: none of them may hold the application.


async def _unknown(request: Request) -> None:
    if errors.methods_at(request):
        raise HTTPException(405)
    raise errors.NotFound(said("nothing_here"))


def _description(request: Request) -> JSONResponse:
    """No coroutine: made for the first time it takes a second, which nobody else shall wait."""
    return JSONResponse(request.app.openapi())


def _largest_body(settings: Settings) -> int:
    return max(settings.max_body_bytes, remote_id_tests.MAX_BODY if settings.uspace.test_harness else 0)


def _operation_id(route: APIRoute) -> str:
    return route.name
