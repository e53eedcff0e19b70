"""What others ask of a drone: a WebSocket to the backend's ingest, over which requests for a proof come in.

The same protocol as the pads' (`wonderland.telemetry`): challenge, hello signed with the ledger
identity, welcome; then ``please_prove`` from the server, and an answer to each. A request is a wish and no command: the
`decide` that is handed in says whether the drone will.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import ssl
from collections.abc import Awaitable, Callable
from typing import Final

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from wonderland import telemetry
from wonderland.proofs.records.sessions import Claim
from wonderland.telemetry import (
    Answer,
    Challenge,
    Credentials,
    PleaseProve,
    Position,
    Refused,
    TelemetryError,
    Welcome,
    end_point_seen,
    hello_to,
)
from wonderland.telemetry.frames import FromServer

_log = logging.getLogger(__name__)
MAX_FRAME: Final = 64 * 1024
GREETING_S: Final = 10.0
FIRST_PAUSE_S: Final = 0.5
LONGEST_PAUSE_S: Final = 30.0
POSITION_EVERY_S: Final = 1.0
KNOWN: Final = 256
"""So many requests are remembered: a server sends one again when it has not heard the answer."""


class RequestsError(Exception):
    """The server is not what it should be, or does not let this drone in; the text says why."""


Decide = Callable[[PleaseProve], Awaitable[str]]
"""Returns why not; an empty text where the drone will."""


class Requests:
    """Listens until cancelled, through faults of the server and the network."""

    def __init__(
        self,
        url: str,
        who: Credentials,
        decide: Decide,
        position: Callable[[], Claim | None] | None = None,
        *,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        """`url`: ws:// or wss:// of the backend's /ingest. `position`: told each second, for Network Remote ID.

        `tls`: of a wss:// address (`telemetry.tls_of`).
        """
        self._url = url
        self._who = who
        self._tls = tls
        self._decide = decide
        self._position = position
        self._seq = 0
        self._spool = secrets.token_hex(16)
        self._answers: dict[str, str] = {}
        self._away = False

    async def run(self) -> None:
        """Keep a connection to the backend, with growing pauses where it fails, until cancelled."""
        pause_s = FIRST_PAUSE_S
        while True:
            try:
                async with connect(
                    self._url, ssl=self._tls, max_size=MAX_FRAME, compression=None, proxy=None
                ) as socket:
                    await self._greet(socket)
                    pause_s = FIRST_PAUSE_S
                    if self._away:
                        _log.warning("%s: the backend is there; requests are heard", self._who.id)
                    self._away = False
                    telling = asyncio.create_task(self._tell(socket))
                    try:
                        await self._listen(socket)
                    finally:
                        telling.cancel()
                        await asyncio.gather(telling, return_exceptions=True)
            except (OSError, TimeoutError, WebSocketException, RequestsError) as error:
                if not self._away:
                    _log.warning("%s: requests are not heard just now, trying on: %s", self._who.id, error)
                self._away = True
            await asyncio.sleep(pause_s * (0.5 + secrets.randbelow(1000) / 1000))
            pause_s = min(LONGEST_PAUSE_S, 2 * pause_s)

    async def _greet(self, socket: ClientConnection) -> None:
        async with asyncio.timeout(GREETING_S):
            challenge = _said(await socket.recv())
            if not isinstance(challenge, Challenge):
                raise RequestsError("the server does not begin with a challenge")
            try:
                seen = end_point_seen(socket.transport.get_extra_info("ssl_object"))
                hello = hello_to(challenge, self._who, spool=self._spool, end_point=seen, takes=("please_prove",))
            except TelemetryError as cause:
                raise RequestsError(str(cause)) from cause
            await socket.send(telemetry.encode(hello))
            answer = _said(await socket.recv())
        if isinstance(answer, Refused):
            raise RequestsError(f"the server refuses this drone: {answer.code}: {answer.message}"[:300])
        if not isinstance(answer, Welcome):
            raise RequestsError("the server does not say whether it knows this drone")

    async def _tell(self, socket: ClientConnection) -> None:
        """Where the drone is, each second. What does not arrive is not sent again: the next one is newer."""
        while self._position is not None:
            claim = self._position()
            if claim is not None:
                self._seq += 1
                body = Position(
                    lat_e7=claim.lat_e7,
                    lon_e7=claim.lon_e7,
                    height_mm=claim.height_mm,
                    accuracy_mm=claim.accuracy_mm,
                    height_accuracy_mm=claim.height_accuracy_mm,
                    claim_t_ms=claim.t_ms,
                )
                record = telemetry.record_of(self._seq, claim.t_ms, body)
                await socket.send(telemetry.encode(telemetry.records_of([record])))
            await asyncio.sleep(POSITION_EVERY_S)

    async def _listen(self, socket: ClientConnection) -> None:
        async for text in socket:
            wish = _said(text)
            if not isinstance(wish, PleaseProve):
                continue
            if wish.request_id not in self._answers:
                self._answers[wish.request_id] = await self._decide(wish)
                while len(self._answers) > KNOWN:
                    del self._answers[next(iter(self._answers))]
            why_not = self._answers[wish.request_id]
            answer = Answer(request_id=wish.request_id, accepted=not why_not, text=telemetry.clean(why_not, 300))
            await socket.send(telemetry.encode(answer))


def _said(text: str | bytes) -> FromServer | None:
    """What the server says; None for what only a later one knows. Raises `RequestsError` for what is no message."""
    try:
        return telemetry.decode_server(text)
    except TelemetryError as cause:
        if cause.code == "unknown_type":
            return None
        raise RequestsError(f"the server sent something that is no message: {cause}") from None
