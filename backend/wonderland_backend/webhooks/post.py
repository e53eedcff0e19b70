"""Sending one signed request to a target that was checked."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Final

import httpx

from wonderland_backend.context import part
from wonderland_backend.errors import SettingsError
from wonderland_backend.http.targets import Destinations, Resolve, Target, TargetRefused, resolve, resolved
from wonderland_backend.settings import Settings
from wonderland_backend.webhooks import signing

TIMEOUT_S: Final = 10.0
TOTAL_S: Final = 15.0
FIRST_RETRY_MS: Final = 10_000
LONGEST_RETRY_MS: Final = 3_600_000


class Undelivered(Exception):  # noqa: N818 - caught, and kept beside the delivery
    """A target did not take it; the text says why. `status`: what it answered, if it did."""

    def __init__(self, text: str, status: int | None = None) -> None:
        super().__init__(text)
        self.status = status


def retry_ms(attempts: int) -> int:
    """How long to wait after so many attempts."""
    return int(min(LONGEST_RETRY_MS, FIRST_RETRY_MS * 2 ** min(attempts - 1, 20)))


class Poster:
    """Sends webhooks."""

    def __init__(self, destinations: Destinations, *, ca_file: Path | None = None, lookup: Resolve = resolve) -> None:
        """Raises `SettingsError` for a CA file that is none."""
        context = ssl.create_default_context()
        if ca_file is not None:
            try:
                context.load_verify_locations(ca_file)
            except OSError as error:
                raise SettingsError(f"webhook_ca_file: {ca_file} cannot be read as certificates ({error})") from None
        self._destinations = destinations
        self._lookup = lookup
        # A redirect could lead anywhere; an address that has moved is a problem to be seen. Each message has a
        # connection of its own: one that is kept would go to the address of another day.
        self._client = httpx.AsyncClient(
            verify=context,
            timeout=TIMEOUT_S,
            follow_redirects=False,
            trust_env=False,
            limits=httpx.Limits(max_keepalive_connections=0),
        )

    async def target(self, url: str) -> Target:
        """Where that leads, name resolved and checked. Raises `TargetRefused`."""
        return await resolved(url, self._destinations, self._lookup)

    async def post(self, url: str, secret: str, message_id: str, t_s: int, body: bytes) -> int:
        """Send it; returns the status, a 2xx. Raises `Undelivered`."""
        try:
            async with asyncio.timeout(TOTAL_S):
                target = await self.target(url)
                headers = {
                    "Host": target.host_header,
                    "Content-Type": "application/json",
                    "User-Agent": "wonderland",
                    **signing.headers(secret, message_id, t_s, body),
                }
                # The answer's body is of no interest, and not read: it may be endless.
                async with self._client.stream(
                    "POST", target.url, content=body, headers=headers, extensions={"sni_hostname": target.host}
                ) as answer:
                    status = answer.status_code
        except TargetRefused as error:
            raise Undelivered(str(error)) from error
        except TimeoutError as error:
            raise Undelivered("it did not answer in time") from error
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise Undelivered(f"{type(error).__name__}: {error}") from error
        if not 200 <= status < 300:
            raise Undelivered(f"it answered {status}", status)
        return status

    async def close(self) -> None:
        """Close what is open."""
        await self._client.aclose()


PosterDep = Annotated[Poster, part(Poster)]


def poster_of(settings: Settings, named: Iterable[str] = ()) -> Poster:
    """As the settings say; `named`: hosts that are allowed besides. Raises `SettingsError`."""
    inside = frozenset(settings.webhook_allowed_hosts).union(named)
    return Poster(Destinations(inside, settings.outbound_hosts), ca_file=settings.webhook_ca_file)
