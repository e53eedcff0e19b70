"""Asking other systems with a token of ours.

The address of a DSS is the administrator's. Those of other providers come from whoever registers with it: they may be
https addresses of the Internet and nothing else, or a provider could have us ask, with a token, within our own network.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

import httpx

from wonderland.problems import said
from wonderland_backend.errors import Problem
from wonderland_backend.http.targets import Destinations, TargetRefused, resolved
from wonderland_backend.http.transfer import TransferError, ask
from wonderland_backend.uspace.token_client import TokenClient


class ProviderAway(Problem):
    """Another system, which has the answer, cannot be asked just now."""

    status, code = HTTPStatus.BAD_GATEWAY, "provider-away"
    example = said("provider_away", why="uss.example.com does not answer")


@dataclass(frozen=True)
class _Where:
    url: str
    headers: dict[str, str]
    extensions: dict[str, str]


class Peers:
    """Requests to other systems, each with a token for its host and no other."""

    def __init__(
        self, client: httpx.AsyncClient, tokens: TokenClient, *, known: Iterable[str], destinations: Destinations
    ) -> None:
        """`known`: hosts that the administrator named; `destinations`: of the others.

        `client` keeps no connections: one that was made for a name must not serve another name at the same address.
        """
        self._client = client
        self._tokens = tokens
        self._known = frozenset(known)
        self._destinations = destinations

    async def ask(self, method: str, url: str, scope: str, **options: Any) -> tuple[int, httpx.Headers, bytes]:
        """Status, headers and body of an answer. Raises `TransferError`."""
        host = _host(url)
        where = await self._where(url, host)
        answer = await self._ask(method, where, host, scope, options)
        if answer[0] == HTTPStatus.UNAUTHORIZED:
            # The token was withdrawn, or its issuer's key: another one may do.
            self._tokens.forget(host, scope)
            answer = await self._ask(method, where, host, scope, options)
        return answer

    async def read(self, url: str, *, max_bytes: int) -> bytes:
        """A file at an address that somebody else named: without a token. Raises `TransferError`."""
        host = _host(url)
        where = await self._where(url, host)
        status, _, body = await ask(
            self._client, "GET", where.url, headers=where.headers, extensions=where.extensions, max_bytes=max_bytes
        )
        if status != HTTPStatus.OK:
            raise TransferError(f"{host} answered {status}")
        return body

    async def _ask(
        self, method: str, where: _Where, host: str, scope: str, options: dict[str, Any]
    ) -> tuple[int, httpx.Headers, bytes]:
        token = await self._tokens.token(host, scope)
        headers = {**where.headers, "Authorization": f"Bearer {token}"}
        return await ask(self._client, method, where.url, headers=headers, extensions=where.extensions, **options)

    async def _where(self, url: str, host: str) -> _Where:
        """The address to connect to, as it was checked, and what keeps the name that was meant."""
        if host in self._known and url.startswith("https:"):
            return _Where(url, {}, {})
        try:
            target = await resolved(url, self._destinations)
        except TargetRefused as error:
            raise TransferError(f"{host}: {error}") from None
        return _Where(target.url, {"Host": target.host_header}, {"sni_hostname": target.host})


def _host(url: str) -> str:
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        raise TransferError("an address that is none") from None
