"""The interface's description (OpenAPI 3.1): put together from the routes, the same bytes each time."""

from __future__ import annotations

from typing import Any, Final

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic.json_schema import models_json_schema

from wonderland_backend import errors
from wonderland_backend.live.schemas import FRAMES
from wonderland_backend.reference.openapi import complete

DESCRIPTION: Final = """\
What Wonderland knows: pads, drones, proofs of location and their verdicts, as the ledger has them; and beside them,
marked unverified, what drones broadcast and what pads measure while a proof is under way.

Times are milliseconds since the Unix epoch (`_ms`), positions WGS-84 degrees × 10⁷ (`_e7`), lengths millimetres
(`_mm`). Lists are paged by cursor. Errors are problem details (RFC 9457). Machines hear of changes by
the event stream `/api/v1/events` or by webhooks. Everything live is on the WebSocket
`/api/v1/live?since=<epoch>:<seq>`, whose frames are the schemas LiveHello, LiveSnapshot and LiveDelta: for a browser
that is signed in, or with a bearer token of the scopes for pads, proofs, tracks and alerts, until it ends (4401).
"""


def openapi(app: FastAPI) -> dict[str, Any]:
    """The interface's description, with the live frames' schemas; the same bytes each time."""
    if app.openapi_schema is None:
        document = get_openapi(
            title=app.title,
            version=app.version,
            description=app.description,
            routes=app.routes,
            webhooks=app.webhooks.routes,
            servers=[{"url": "/", "description": "The server that this description comes from"}],
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
        document["components"]["schemas"] = dict(sorted(schemas.items()))
        complete(document)
        app.openapi_schema = document
    return app.openapi_schema


def _problem_schema(schemas: dict[str, Any]) -> dict[str, Any]:
    schema = errors.ProblemDetails.model_json_schema(ref_template="#/components/schemas/{model}")
    for name, definition in schema.pop("$defs", {}).items():
        schemas.setdefault(name, definition)
    return schema
