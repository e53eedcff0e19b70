"""Our own tokens for other systems: OAuth 2.0 client credentials, one token for each audience and scope, kept."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import httpx

from wonderland_backend.http.transfer import TransferError, ask_object
from wonderland_backend.settings.uspace import USpaceSettings

SPARE_S: Final = 60
"""A token that ends sooner is replaced: it must outlast the request that it is made for."""
RETRY_S: Final = 5
LONGEST_S: Final = 3_600
MAX_KEPT: Final = 512
MAX_ANSWER: Final = 64 * 1024


class NoToken(TransferError):  # noqa: N818 - what there is then
    """We have no token for another system, and cannot get one now."""


@dataclass(slots=True)
class _Kept:
    token: str
    until_s: float
    problem: str = ""


class TokenClient:
    """Gets and keeps access tokens."""

    def __init__(self, settings: USpaceSettings, *, clock: Callable[[], int], client: httpx.AsyncClient) -> None:
        """`clock` gives milliseconds since the Unix epoch."""
        self._settings = settings
        self._clock = clock
        self._client = client
        self._kept: OrderedDict[tuple[str, str], _Kept] = OrderedDict()
        self._asking = asyncio.Lock()

    async def token(self, audience: str, scope: str) -> str:
        """A token for the host `audience` with `scope`. Raises `NoToken`."""
        known = self._good(audience, scope)
        if known is None:
            async with self._asking:
                known = self._good(audience, scope) or await self._new(audience, scope)
        if known.problem:
            raise NoToken(known.problem)
        return known.token

    def forget(self, audience: str, scope: str) -> None:
        """A token that was refused; the next call asks for another."""
        self._kept.pop((audience, scope), None)

    def _good(self, audience: str, scope: str) -> _Kept | None:
        kept = self._kept.get((audience, scope))
        return kept if kept is not None and kept.until_s > self._clock() / 1000 else None

    async def _new(self, audience: str, scope: str) -> _Kept:
        now_s = self._clock() / 1000
        try:
            answer = await self._ask(audience, scope)
            lifetime_s = _lifetime_s(answer)
            kept = _Kept(_token(answer), now_s + max(RETRY_S, lifetime_s - SPARE_S))
        except TransferError as error:
            # Kept, too, for a moment: a server that is away must not be asked by every request that needs it.
            kept = _Kept("", now_s + RETRY_S, f"no access token: {error}")
        self._kept[audience, scope] = kept
        while len(self._kept) > MAX_KEPT:
            self._kept.popitem(last=False)
        return kept

    async def _ask(self, audience: str, scope: str) -> dict[str, Any]:
        settings = self._settings
        if settings.token_url is None or settings.client_id is None:
            raise TransferError("token_url and client_id are not set")
        form = {"grant_type": "client_credentials", "scope": scope}
        if settings.token_request == "interuss-dummy":  # noqa: S105 - which server it is, no secret
            form |= {"intended_audience": audience, "issuer": "dummy", "sub": settings.client_id}
            return await ask_object(self._client, "GET", settings.token_url, params=form, max_bytes=MAX_ANSWER)
        form[settings.token_request] = audience
        credentials = (settings.client_id, self._secret())
        return await ask_object(
            self._client, "POST", settings.token_url, data=form, auth=credentials, max_bytes=MAX_ANSWER
        )

    def _secret(self) -> str:
        path = self._settings.client_secret_file
        if path is None:
            return self._settings.client_secret or ""
        try:
            return path.read_text().strip()
        except (OSError, UnicodeDecodeError):
            raise TransferError("client_secret_file cannot be read") from None


def _token(answer: dict[str, Any]) -> str:
    token = answer.get("access_token")
    if not isinstance(token, str) or not token or not token.isascii() or not token.isprintable():
        raise TransferError("the answer has no access_token")
    return token


def _lifetime_s(answer: dict[str, Any]) -> float:
    """By `expires_in` (RFC 6749); an answer that does not say is good for one request."""
    lifetime = answer.get("expires_in", 0)
    if isinstance(lifetime, bool) or not isinstance(lifetime, int | float):
        return 0
    return min(max(0.0, float(lifetime)), LONGEST_S)
