"""Links that the server's own operator makes, on its command line: whoever has a shell there is trusted."""

from __future__ import annotations

from typing import Final

from wonderland_backend import audit
from wonderland_backend.auth.store.sign_ins import DISPLAY, SIGN_IN, SignIns
from wonderland_backend.db.engine import Database
from wonderland_backend.errors import BackendError
from wonderland_backend.people import store
from wonderland_backend.people.accept import SET_UP
from wonderland_backend.person import roles_of

SHELL: Final = "the server's command line"
DEMO: Final = "Demo"


async def at_start(database: Database, sign_ins: SignIns, *, demo: bool) -> str | None:
    """What the server's start prints: a demo's visitor is signed in at once; a server without anybody is set up.

    None for a server that has been set up.
    """
    if demo:
        return await sign_ins.new_token(DEMO, ("admin",))
    if await sign_ins.is_set_up():
        return None
    async with database.write() as connection:
        return await sign_ins.new_link(connection, SET_UP, None)


async def for_administrator(database: Database, sign_ins: SignIns, name: str | None, now_ms: int) -> str:
    """A link that signs an administrator in at once, for one who has lost every other sign-in method.

    On a server that has not been set up it makes the first administrator, if there is a name; else it is the link to
    set the server up. Raises `BackendError` where it is not clear whose it should be.
    """
    if not await sign_ins.is_set_up():
        if name is not None:
            return await sign_ins.new_token(name, ("admin",))
        async with database.write() as connection:
            return await sign_ins.new_link(connection, SET_UP, None)
    async with database.write() as connection:
        found = [row for row in await store.active(connection) if "admin" in roles_of(row.roles)]
        chosen = [row for row in found if name is None or row.name == name]
        if len(chosen) != 1:
            names = ", ".join(sorted(row.name for row in found))
            raise BackendError(f"--name: say which administrator; there are: {names}")
        token = await sign_ins.new_link(connection, SIGN_IN, chosen[0].person_id)
        await audit.record(connection, SHELL, "sign_in_link_made", store.subject(chosen[0].person_id), t_ms=now_ms)
    return token


async def for_display(database: Database, sign_ins: SignIns, name: str, now_ms: int) -> str:
    """A link that signs a screen in which nobody operates: as a viewer, for long. Raises `BackendError`."""
    if not await sign_ins.is_set_up():
        raise BackendError("--display: set the server up first; `wonderland backend link` prints the link for that")
    token = await sign_ins.new_token(name, ("viewer",), kind=DISPLAY)
    async with database.write() as connection:
        await audit.record(connection, SHELL, "display_link_made", "", {"name": name}, t_ms=now_ms)
    return token
