"""People's sign-ins: a one-time token buys a cookie; the server keeps hashes of both, and ends them.

The seam for more ways to sign in (OIDC, passkeys) is `SignIns.begin`: whatever has established who somebody is calls
it and sets the cookie.
"""

from __future__ import annotations

import hashlib
import hmac
from base64 import urlsafe_b64encode
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from sqlalchemy import delete, insert, select, update

from backend.auth.schemas import SignedIn
from backend.db.engine import Database
from backend.db.models import SignInRow, SignInTokenRow
from backend.errors import SignInRequired
from backend.settings import Settings

TOKEN_BYTES: Final = 32
METHOD: Final = "one_time_token"
_TOUCH_MS: Final = 60_000
"""`last_seen` is written at most this often."""


@dataclass(frozen=True)
class Person:
    """Who a request comes from."""

    name: str
    roles: tuple[str, ...]
    signed_in_ms: int
    expires_ms: int
    cookie_sha256: str

    def described(self) -> SignedIn:
        """As the REST interface shows it."""
        return SignedIn(
            name=self.name,
            roles=list(self.roles),
            method=METHOD,
            signed_in_ms=self.signed_in_ms,
            expires_ms=self.expires_ms,
        )


class SignIns:
    """Issues one-time tokens, turns them into cookies, knows who a cookie is."""

    def __init__(
        self, database: Database, settings: Settings, clock: Callable[[], int], randomness: Callable[[int], bytes]
    ) -> None:
        self._database = database
        self._settings = settings
        self._clock = clock
        self._randomness = randomness

    async def new_token(self, name: str, roles: tuple[str, ...], ttl_s: int | None = None) -> str:
        """A token that lets one browser sign in once, before it expires. Only its hash is kept."""
        token = self._secret()
        now = self._clock()
        row = {
            "token_sha256": _sha256(token),
            "name": name,
            "roles": " ".join(roles),
            "created_ms": now,
            "expires_ms": now + (ttl_s or self._settings.token_ttl_s) * 1000,
            "used_ms": None,
        }
        async with self._database.write() as connection:
            await connection.execute(delete(SignInTokenRow).where(SignInTokenRow.expires_ms < now - 86_400_000))
            await connection.execute(insert(SignInTokenRow), [row])
        return token

    async def redeem(self, token: str) -> tuple[str, Person]:
        """The cookie for a token, which is then spent. Raises `SignInRequired` for any other text."""
        now = self._clock()
        digest = _sha256(token)
        async with self._database.write() as connection:
            spent = await connection.execute(
                update(SignInTokenRow)
                .where(
                    SignInTokenRow.token_sha256 == digest,
                    SignInTokenRow.used_ms.is_(None),
                    SignInTokenRow.expires_ms > now,
                )
                .values(used_ms=now)
            )
            if spent.rowcount != 1:
                raise SignInRequired(
                    "The link was used before, has expired, or is not of this server. "
                    "`wonderland backend link` prints a new one."
                )
            found = await connection.execute(
                select(SignInTokenRow.name, SignInTokenRow.roles).where(SignInTokenRow.token_sha256 == digest)
            )
            name, roles = found.one()
        return await self.begin(name, tuple(roles.split()))

    async def begin(self, name: str, roles: tuple[str, ...]) -> tuple[str, Person]:
        """Start a sign-in of somebody whose identity is established: the cookie's value, and who it is."""
        cookie = self._secret()
        now = self._clock()
        expires = now + self._settings.sign_in_ttl_s * 1000
        digest = _sha256(cookie)
        row = {
            "cookie_sha256": digest,
            "name": name,
            "roles": " ".join(roles),
            "method": METHOD,
            "created_ms": now,
            "expires_ms": expires,
            "last_seen_ms": now,
        }
        async with self._database.write() as connection:
            await connection.execute(delete(SignInRow).where(SignInRow.expires_ms < now))
            await connection.execute(insert(SignInRow), [row])
        return cookie, Person(name, roles, now, expires, digest)

    async def find(self, cookie: str | None) -> Person | None:
        """Who a cookie is; None when nobody, or no longer."""
        if not cookie or len(cookie) > 128:
            return None
        return await self.find_by_hash(_sha256(cookie))

    async def find_by_hash(self, cookie_sha256: str) -> Person | None:
        """The same by the cookie's hash: for connections that last."""
        now = self._clock()
        async with self._database.read() as session:
            row = await session.get(SignInRow, cookie_sha256)
        if row is None or not hmac.compare_digest(row.cookie_sha256, cookie_sha256):
            return None
        if row.expires_ms <= now or row.last_seen_ms + self._settings.sign_in_idle_s * 1000 <= now:
            return None
        if row.last_seen_ms + _TOUCH_MS < now:
            async with self._database.write() as connection:
                await connection.execute(
                    update(SignInRow).where(SignInRow.cookie_sha256 == cookie_sha256).values(last_seen_ms=now)
                )
        return Person(row.name, tuple(row.roles.split()), row.created_ms, row.expires_ms, cookie_sha256)

    async def end(self, cookie_sha256: str) -> None:
        """Sign out."""
        async with self._database.write() as connection:
            await connection.execute(delete(SignInRow).where(SignInRow.cookie_sha256 == cookie_sha256))

    def _secret(self) -> str:
        return urlsafe_b64encode(self._randomness(TOKEN_BYTES)).rstrip(b"=").decode()


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()
