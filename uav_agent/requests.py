"""What others ask of a drone: a WebSocket to the backend's ingest, over which requests for a proof come in.

The same protocol as the pads' (docs/seams.md, "Agents → backend: ingest"): challenge, hello signed with the ledger
identity, welcome; then ``please_prove`` from the server, and an answer to each. A request is a wish and no command: the
`decide` that is handed in says whether the drone will.
"""

from __future__ import annotations

import asyncio
import json
import logging
import secrets
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from wonderland.ledger.identity import Identity
from wonderland.ledger.signing import Signer
from wonderland.proofs import encoding
from wonderland.proofs.records.fields import ACTIONS
from wonderland.proofs.records.sessions import Claim

_log = logging.getLogger(__name__)
PROTOCOL: Final = "wonderland-ingest/1"
PURPOSE: Final = "wonderland-ingest"
SERVER: Final = "wonderland"
MAX_FRAME: Final = 64 * 1024
GREETING_S: Final = 10.0
FIRST_PAUSE_S: Final = 0.5
LONGEST_PAUSE_S: Final = 30.0
POSITION_EVERY_S: Final = 1.0
KNOWN: Final = 256
"""So many requests are remembered: a server sends one again when it has not heard the answer."""


class RequestsError(Exception):
    """The server is not what it should be, or does not let this drone in; the text says why."""


@dataclass(frozen=True, slots=True)
class Wish:
    """Somebody asks that this drone proves itself at a pad."""

    request_id: str
    pad_id: str
    action: str
    expires_ms: int


Decide = Callable[[Wish], Awaitable[str]]
"""Returns why not; an empty text where the drone will."""


class Requests:
    """Listens until cancelled, through faults of the server and the network."""

    def __init__(
        self,
        url: str,
        uav_id: str,
        identity: Identity,
        signer: Signer,
        decide: Decide,
        position: Callable[[], Claim | None] | None = None,
    ) -> None:
        """`url`: ws:// or wss:// of the backend's /ingest. `position`: told each second, for Network Remote ID."""
        self._url = url
        self._uav_id = uav_id
        self._identity = identity
        self._signer = signer
        self._decide = decide
        self._position = position
        self._seq = 0
        self._spool = secrets.token_hex(16)
        self._answers: dict[str, str] = {}

    async def run(self) -> None:
        """Until cancelled."""
        pause_s = FIRST_PAUSE_S
        while True:
            try:
                async with connect(self._url, max_size=MAX_FRAME, compression=None, proxy=None) as socket:
                    await self._greet(socket)
                    pause_s = FIRST_PAUSE_S
                    telling = asyncio.create_task(self._tell(socket))
                    try:
                        await self._listen(socket)
                    finally:
                        telling.cancel()
                        await asyncio.gather(telling, return_exceptions=True)
            except (OSError, TimeoutError, WebSocketException, RequestsError) as error:
                _log.warning("%s: requests are not heard just now: %s", self._uav_id, error)
            await asyncio.sleep(pause_s * (0.5 + secrets.randbelow(1000) / 1000))
            pause_s = min(LONGEST_PAUSE_S, 2 * pause_s)

    async def _greet(self, socket: ClientConnection) -> None:
        async with asyncio.timeout(GREETING_S):
            challenge = _object(await socket.recv())
            if challenge.get("type") != "challenge" or not isinstance(challenge.get("nonce"), str):
                raise RequestsError("the server does not begin with a challenge")
            about = {"server": SERVER, "agent": "uav", "id": self._uav_id, "spool": self._spool}
            text = encoding.encode({"purpose": PURPOSE, "nonce": challenge["nonce"], **about})
            hello = {
                "type": "hello",
                "protocol": PROTOCOL,
                "agent": "uav",
                "id": self._uav_id,
                "spool": self._spool,
                "msp_id": self._identity.msp_id,
                "certificate": self._identity.certificate_pem.decode(),
                "signature": encoding.to_base64url(self._signer(text)),
                "takes": ["please_prove"],
            }
            await socket.send(json.dumps(hello))
            answer = _object(await socket.recv())
        if answer.get("type") != "welcome":
            raise RequestsError(f"the server refuses this drone: {answer.get('code')}: {answer.get('message')}"[:300])

    async def _tell(self, socket: ClientConnection) -> None:
        """Where the drone is, each second. What does not arrive is not sent again: the next one is newer."""
        while self._position is not None:
            claim = self._position()
            if claim is not None:
                self._seq += 1
                body = {**claim.to_json(), "claim_t_ms": claim.t_ms}
                del body["t_ms"]
                record = {"seq": self._seq, "kind": "position", "t_ms": claim.t_ms, "body": body}
                await socket.send(json.dumps({"type": "records", "records": [record]}))
            await asyncio.sleep(POSITION_EVERY_S)

    async def _listen(self, socket: ClientConnection) -> None:
        async for text in socket:
            message = _object(text)
            if message.get("type") != "please_prove":
                continue  # A later server may have more to say.
            wish = _wish(message)
            if wish.request_id not in self._answers:
                self._answers[wish.request_id] = await self._decide(wish)
                while len(self._answers) > KNOWN:
                    del self._answers[next(iter(self._answers))]
            why_not = self._answers[wish.request_id]
            answer = {"type": "answer", "request_id": wish.request_id, "accepted": not why_not, "text": why_not[:300]}
            await socket.send(json.dumps(answer))


def _object(text: str | bytes) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise RequestsError("the server sent something that is no JSON object")
    return found


def _wish(message: dict[str, Any]) -> Wish:
    request_id, pad_id, action = (message.get(name) for name in ("request_id", "pad_id", "action"))
    expires_ms = message.get("expires_ms")
    texts = isinstance(request_id, str) and isinstance(pad_id, str) and len(request_id) == 32 and len(pad_id) <= 64
    if not texts or action not in ACTIONS or type(expires_ms) is not int:
        raise RequestsError("the server sent a request that is none")
    assert isinstance(request_id, str)
    assert isinstance(pad_id, str)
    return Wish(request_id, pad_id, str(action), expires_ms)
