"""Asking other systems over HTTP: never longer, never larger, never elsewhere than was meant."""

from __future__ import annotations

import asyncio
import functools
import ssl
import zlib
from http import HTTPStatus
from typing import Any, Final

import httpx
import orjson

TIMEOUT_S: Final = 10.0
MAX_ANSWER: Final = 4 << 20


class TransferError(Exception):
    """Another system could not be asked, or its answer cannot be used; the text says why."""


@functools.cache
def _trusted() -> ssl.SSLContext:
    """The system's certificates; reading them takes a while."""
    return httpx.create_ssl_context()


def new_client(*, keep: int = 32) -> httpx.AsyncClient:
    """A client for one backend: bounded, without redirects (one could lead anywhere) and without a proxy.

    `keep`: how many idle connections it keeps.
    """
    limits = httpx.Limits(max_connections=64, max_keepalive_connections=keep, keepalive_expiry=30.0)
    return httpx.AsyncClient(
        timeout=TIMEOUT_S, limits=limits, verify=_trusted(), follow_redirects=False, trust_env=False
    )


async def ask(
    client: httpx.AsyncClient, method: str, url: str, *, max_bytes: int = MAX_ANSWER, **options: Any
) -> tuple[int, httpx.Headers, bytes]:
    """Status, headers and body of an answer; the whole exchange is bounded in time. Raises `TransferError`."""
    headers = {"Accept-Encoding": "gzip", **(options.pop("headers", None) or {})}
    try:
        async with (
            asyncio.timeout(2 * TIMEOUT_S),
            client.stream(method, url, headers=headers, **options) as answer,
        ):
            body = await _read(answer, max_bytes, _host(url))
    except httpx.HTTPError as error:
        raise TransferError(f"{_host(url)}: {type(error).__name__} {error}".rstrip()) from None
    except (httpx.InvalidURL, ValueError) as error:
        raise TransferError(f"an address that is none: {error}") from None
    except TimeoutError:
        raise TransferError(f"{_host(url)} did not answer in time") from None
    return answer.status_code, answer.headers, body


async def _read(answer: httpx.Response, max_bytes: int, host: str) -> bytes:
    """The body, unpacked within bounds: a few kilobytes, packed twice, are gigabytes."""
    encoding = answer.headers.get("content-encoding", "identity").strip().lower()
    if encoding not in {"identity", "gzip"}:
        raise TransferError(f"{host} sends an encoding that it was not asked for: {encoding[:40]}")
    unpacker = zlib.decompressobj(wbits=31) if encoding == "gzip" else None
    body = bytearray()
    received = 0
    async for part in answer.aiter_raw():
        received += len(part)
        try:
            body += part if unpacker is None else unpacker.decompress(part, max_bytes + 1 - len(body))
        except zlib.error as error:
            raise TransferError(f"{host} sends what is not gzip ({error})") from None
        if len(body) > max_bytes or received > max_bytes:
            raise TransferError(f"{host} sends more than {max_bytes} bytes")
        if unpacker is not None and (unpacker.unused_data or unpacker.unconsumed_tail):
            raise TransferError(f"{host} sends more than one packed body")
    if unpacker is not None and received and not unpacker.eof:
        raise TransferError(f"{host} ended its answer early")
    return bytes(body)


async def ask_object(client: httpx.AsyncClient, method: str, url: str, **options: Any) -> dict[str, Any]:
    """As `ask`, for an answer that can only be 200 with a JSON object. Raises `TransferError`."""
    status, _, body = await ask(client, method, url, **options)
    if status != HTTPStatus.OK:
        raise TransferError(f"{_host(url)} answered {status}")
    return parse_object(body, url)


def parse_object(body: bytes, who: str) -> dict[str, Any]:
    """A JSON object. Raises `TransferError`."""
    try:
        found = orjson.loads(body)
    except orjson.JSONDecodeError:
        found = None
    if not isinstance(found, dict):
        raise TransferError(f"{_host(who)} did not answer with a JSON object")
    return found


def _host(url: str) -> str:
    """An address for a log or an error: what follows the host may say more than others should read."""
    try:
        return httpx.URL(url).netloc.decode("ascii", "replace") or url[:100]
    except httpx.InvalidURL:
        return url[:100]
