"""An answer as a statement that can be shown to others (`wonderland_evidence.statements`)."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Annotated, Any, Final

import orjson
from fastapi import Depends, Request
from fastapi.responses import Response

from wonderland.problems import said
from wonderland_backend.context import maybe
from wonderland_backend.errors import NotAcceptable
from wonderland_backend.responses import prefers
from wonderland_evidence.statements import MEDIA_TYPE, compose
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import Signer


class Statements:
    """Signs as the identity that anchors the audit log: its certificate is on the ledger with each anchor."""

    def __init__(
        self, identity: Identity, signer: Signer, channel: str, authorities: Callable[[str], tuple[bytes, ...]]
    ) -> None:
        """`authorities`: certificates (PEM) of an organisation's authorities, as the ledger has them now."""
        self._identity: Final = identity
        self._signer = signer
        self._channel = channel
        self._authorities = authorities

    async def answer(self, about: str, content: Any, now_ms: int) -> Response:
        """A statement as an answer."""
        plain = orjson.loads(orjson.dumps(content))

        def composed() -> str:
            return compose(
                about,
                plain,
                channel=self._channel,
                identity=self._identity,
                authorities=self._authorities(self._identity.msp_id),
                issued_s=now_ms // 1000,
                sign=self._signer,
            )

        text = await asyncio.to_thread(composed)  # the key may be in a module that takes its time
        headers = {"Cache-Control": "private, no-store", "Vary": "Accept, Accept-Language"}
        return Response(text, media_type=MEDIA_TYPE, headers=headers)


async def _wanted(request: Request, statements: Annotated[Statements | None, maybe(Statements)]) -> Statements | None:
    """Raises `NotAcceptable` where this server signs nothing."""
    if not prefers(request, MEDIA_TYPE):
        return None
    if statements is None:
        raise NotAcceptable(said("statements_off"))
    return statements


WantedStatements = Annotated[Statements | None, Depends(_wanted)]
"""None where plain JSON is asked for."""
_SCHEMA: Final = {"type": "string", "description": "JWS in its compact form: docs/api/statements.md"}


def documented(told: dict[int | str, dict[str, Any]]) -> dict[int | str, dict[str, Any]]:
    """The ``responses`` of a route that answers in this form as well."""
    found = told.get(200, {})
    return told | {200: {**found, "content": {**found.get("content", {}), MEDIA_TYPE: {"schema": _SCHEMA}}}}
