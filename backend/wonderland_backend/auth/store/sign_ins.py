"""Signed-in browsers: whatever has established who somebody is calls `SignIns.begin` and sets the cookie."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any, Final

from sqlalchemy import delete, insert, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland.problems import said
from wonderland_backend import audit
from wonderland_backend.auth.secret import MAX_SECRET, new_id, new_secret, sha256
from wonderland_backend.context import part
from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.people import LinkRow, PersonRow, SignInRow
from wonderland_backend.errors import SignInRequired
from wonderland_backend.person import Person, Role, roles_of
from wonderland_backend.settings import Settings

ACTIVE: Final = "active"
SIGN_IN: Final = "sign_in"
PASSKEY: Final = "passkey"
DISPLAY: Final = "display"
"""A link, and a sign-in by it, for a screen that nobody operates: it only shows, and is never unused."""
_TOUCH_MS: Final = 60_000
"""`last_seen` is written at most this often."""
_WHO: Final = (
    SignInRow.cookie_sha256, SignInRow.method, SignInRow.created_ms, SignInRow.expires_ms, SignInRow.last_seen_ms,
    SignInRow.verified_ms, PersonRow.person_id, PersonRow.name, PersonRow.roles, PersonRow.msp_id, PersonRow.state,
)  # fmt: skip
_LINK_REFUSED: Final = said("link_refused")


class SignIns:
    """Begins and ends sign-ins, knows who a cookie is."""

    def __init__(
        self, database: Database, settings: Settings, clock: Callable[[], int], randomness: Callable[[int], bytes]
    ) -> None:
        self._database = database
        self._settings = settings
        self._clock = clock
        self._randomness = randomness
        self._set_up = False

    async def new_token(
        self, name: str, roles: Sequence[Role], *, msp_id: str = "", ttl_s: int | None = None, kind: str = SIGN_IN
    ) -> str:
        """A link's token that signs one browser in at once, as a visitor of this name: for the demo and for tests."""
        now = self._clock()
        visitor = {
            "person_id": sha256(f"visitor {name} {sorted(roles)} {msp_id}")[:32],
            "name": name,
            "roles": " ".join(roles),
            "msp_id": msp_id,
            "state": ACTIVE,
            "created_ms": now,
            "changed_ms": now,
            "revision": 0,
        }
        async with self._database.write() as connection:
            known = select(PersonRow.person_id).where(PersonRow.person_id == visitor["person_id"])
            if (await connection.execute(known)).first() is None:
                await connection.execute(insert(PersonRow), [visitor])
            return await self.new_link(connection, kind, str(visitor["person_id"]), ttl_s=ttl_s)

    async def new_link(
        self, connection: AsyncConnection, kind: str, person_id: str | None, *, ttl_s: int | None = None
    ) -> str:
        """A token that serves once, before it expires. Earlier ones of its kind for this person end."""
        token = new_secret(self._randomness)
        now = self._clock()
        await connection.execute(delete(LinkRow).where(LinkRow.expires_ms < now - 86_400_000))
        if kind != SIGN_IN:
            same = LinkRow.person_id.is_(None) if person_id is None else LinkRow.person_id == person_id
            await connection.execute(delete(LinkRow).where(same, LinkRow.kind == kind, LinkRow.used_ms.is_(None)))
        row = {
            "token_sha256": sha256(token),
            "kind": kind,
            "person_id": person_id,
            "created_ms": now,
            "expires_ms": now + (ttl_s or self._settings.token_ttl_s) * 1000,
            "used_ms": None,
        }
        await connection.execute(insert(LinkRow), [row])
        return token

    async def find_link(self, connection: AsyncConnection, token_sha256: str) -> Any:
        """The row of a link that can still be used. Raises `SignInRequired`."""
        found = await connection.execute(
            select(LinkRow.token_sha256, LinkRow.kind, LinkRow.person_id, LinkRow.expires_ms).where(
                LinkRow.token_sha256 == token_sha256, LinkRow.used_ms.is_(None), LinkRow.expires_ms > self._clock()
            )
        )
        row = found.first()
        if row is None:
            raise SignInRequired(_LINK_REFUSED)
        return row

    async def spend(self, connection: AsyncConnection, token_sha256: str, *kinds: str) -> Any:
        """Use up a link of one of these kinds; its row. Raises `SignInRequired`."""
        row = await self.find_link(connection, token_sha256)
        spent = await connection.execute(
            update(LinkRow)
            .where(LinkRow.token_sha256 == token_sha256, LinkRow.used_ms.is_(None), LinkRow.kind.in_(kinds))
            .values(used_ms=self._clock())
        )
        if spent.rowcount != 1:
            raise SignInRequired(_LINK_REFUSED)
        return row

    async def redeem(self, token: str, browser: str = "", former: str | None = None) -> tuple[str, Person]:
        """The cookie for a link that signs in at once. Raises `SignInRequired` for any other text."""
        async with self._database.write() as connection:
            link = await self.spend(connection, sha256(token), SIGN_IN, DISPLAY)
            method = DISPLAY if link.kind == DISPLAY else "link"
            return await self.begin(connection, link.person_id, method, browser, former)

    async def begin(
        self,
        connection: AsyncConnection,
        person_id: str,
        method: str,
        browser: str = "",
        former: str | None = None,
    ) -> tuple[str, Person]:
        """Start a sign-in of somebody whose identity is established: the cookie's value, and who it is.

        `former`: the cookie that this browser had; it is worth nothing from now on. Raises `SignInRequired` for
        somebody who is not active.
        """
        cookie = new_secret(self._randomness)
        now = self._clock()
        ttl_s = self._settings.display_ttl_s if method == DISPLAY else self._settings.sign_in_ttl_s
        row = {
            "cookie_sha256": sha256(cookie),
            "sign_in_id": new_id(self._randomness),
            "person_id": person_id,
            "method": method,
            "browser": browser[:256],
            "created_ms": now,
            "expires_ms": now + ttl_s * 1000,
            "last_seen_ms": now,
            "verified_ms": now if method == PASSKEY else 0,
        }
        over = SignInRow.expires_ms < now
        if former:
            over |= SignInRow.cookie_sha256 == sha256(former)
        await connection.execute(delete(SignInRow).where(over))
        await connection.execute(insert(SignInRow), [row])
        found = (await connection.execute(_of_cookie(sha256(cookie)))).one()
        if found.state != ACTIVE:
            raise SignInRequired(said("account_suspended"))
        person = _person(found)
        subject = f"person/{person_id}"
        await audit.record(connection, person, "sign_in", subject, {"method": method}, t_ms=now)
        return cookie, person

    async def is_set_up(self) -> bool:
        """Whether anybody can sign in. Once so, always so: the last administrator cannot be removed."""
        if not self._set_up:
            async with self._database.read() as session:
                known = select(PersonRow.person_id).where(PersonRow.state == ACTIVE).limit(1)
                self._set_up = (await session.execute(known)).first() is not None
        return self._set_up

    async def person_of_cookie(self, cookie: str | None) -> Person | None:
        """Who a cookie is; None when nobody, or no longer."""
        if not cookie or len(cookie) > MAX_SECRET:
            return None
        return await self.find_by_hash(sha256(cookie))

    async def find_by_hash(self, cookie_sha256: str) -> Person | None:
        """The same by the cookie's hash: for connections that last.

        Asking is no use of a sign-in: pages ask by themselves for as long as they stand open.
        """
        now = self._clock()
        async with self._database.read() as session:
            row = (await session.execute(_of_cookie(cookie_sha256))).first()
        if row is None or row.state != ACTIVE:
            return None
        if row.expires_ms <= now:
            return None
        person = _person(row)
        # Whoever may do more than look is somebody, also on a screen that was signed in as a display.
        is_display = person.method == DISPLAY and person.roles == ("viewer",)
        if not is_display and row.last_seen_ms + self._settings.sign_in_idle_s * 1000 <= now:
            return None
        return person

    async def use(self, person: Person) -> None:
        """Somebody did something: the idle time begins anew."""
        now = self._clock()
        async with self._database.write() as connection:
            await connection.execute(
                update(SignInRow)
                .where(SignInRow.cookie_sha256 == person.cookie_sha256, SignInRow.last_seen_ms < now - _TOUCH_MS)
                .values(last_seen_ms=now)
            )

    async def end(self, person: Person) -> None:
        """Forget this sign-in: its cookie is worth nothing from now on."""
        async with self._database.write() as connection:
            await connection.execute(delete(SignInRow).where(SignInRow.cookie_sha256 == person.cookie_sha256))
            await audit.record(connection, person, "sign_out", f"person/{person.person_id}", t_ms=self._clock())


async def note_verified(connection: AsyncConnection, cookie_sha256: str, now_ms: int) -> None:
    """Its person has just proved to be there."""
    await connection.execute(
        update(SignInRow).where(SignInRow.cookie_sha256 == cookie_sha256).values(verified_ms=now_ms)
    )


SignInsDep = Annotated[SignIns, part(SignIns)]


def _of_cookie(cookie_sha256: str) -> Any:
    return select(*_WHO).join_from(SignInRow, PersonRow).where(SignInRow.cookie_sha256 == cookie_sha256)


def _person(row: Any) -> Person:
    return Person(
        person_id=row.person_id,
        name=row.name,
        roles=roles_of(row.roles),
        msp_id=row.msp_id,
        method=row.method,
        signed_in_ms=row.created_ms,
        expires_ms=row.expires_ms,
        cookie_sha256=row.cookie_sha256,
        verified_ms=row.verified_ms,
    )
