"""Accepting a link: the first administrator's, an invitation, a way back. Somebody proves who they are from now on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy.exc import IntegrityError
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland.problems import said
from wonderland_backend import audit
from wonderland_backend.audit.store import take_turns
from wonderland_backend.auth.oidc import Identity
from wonderland_backend.auth.secret import new_id
from wonderland_backend.auth.store.sign_ins import SignIns
from wonderland_backend.context import Context
from wonderland_backend.errors import Conflict, SignInRequired
from wonderland_backend.people import store
from wonderland_backend.people.schemas import Invitation
from wonderland_backend.person import Account

SET_UP: Final = "set_up"
INVITATION: Final = "invitation"
RECOVERY: Final = "recovery"
KINDS: Final = (SET_UP, INVITATION, RECOVERY)
FIRST: Final = "The first administrator"


@dataclass(frozen=True)
class Acceptance:
    """What is kept of a link while the browser, or the provider, is asked for proof."""

    token_sha256: str
    person_id: str
    name: str

    @classmethod
    def of(cls, kept: dict[str, Any]) -> Acceptance:
        """From a ceremony's content."""
        return cls(kept["token_sha256"], kept["person_id"], kept["name"])

    def to_json(self) -> dict[str, Any]:
        """For a ceremony's content."""
        return {"token_sha256": self.token_sha256, "person_id": self.person_id, "name": self.name}


async def open_link(
    context: Context, sign_ins: SignIns, connection: AsyncConnection, token_sha256: str, name: str | None
) -> tuple[Any, Acceptance]:
    """The link's row, and whose it is or will be. Raises `SignInRequired` for a link that is none."""
    link = await sign_ins.find_link(connection, token_sha256)
    if link.person_id is None:
        return link, Acceptance(token_sha256, new_id(context.randomness), name or FIRST)
    person = await store.find_person(connection, link.person_id)
    return link, Acceptance(token_sha256, link.person_id, person["name"])


async def accept(context: Context, sign_ins: SignIns, connection: AsyncConnection, acceptance: Acceptance) -> Account:
    """Spend the link and make its person active; whoever comes back loses all earlier sign-in methods.

    Raises `SignInRequired`, and `Conflict` where somebody has set the server up meanwhile.
    """
    link = await sign_ins.spend(connection, acceptance.token_sha256, *KINDS)
    now = context.clock()
    account = Account(acceptance.person_id, acceptance.name)
    if link.kind == SET_UP:
        await take_turns(connection)
        if await store.is_anybody_active(connection):
            raise Conflict(said("set_up_already"))
        wanted = Invitation(name=acceptance.name, roles=["admin"])
        await store.create(connection, account, wanted, account.person_id, state=store.ACTIVE, now_ms=now)
        return account
    person = await store.find_person(connection, account.person_id)
    if link.kind == INVITATION and person["state"] == store.INVITED:
        await activate(connection, account, now)
    elif link.kind == RECOVERY and person["state"] == store.ACTIVE:
        await store.forget_methods(connection, account.person_id)
        await store.end_all(connection, account.person_id)
        await audit.record(connection, account, "account_recovered", store.subject(account.person_id), t_ms=now)
    else:
        raise SignInRequired(said("link_outlived"))
    return account


async def activate(connection: AsyncConnection, account: Account, now_ms: int) -> None:
    """An invitation is accepted."""
    await store.activate(connection, account.person_id, now_ms)
    await audit.record(connection, account, "invitation_accepted", store.subject(account.person_id), t_ms=now_ms)


async def link_identity(connection: AsyncConnection, account: Account, identity: Identity, now_ms: int) -> None:
    """From now on the provider vouches for this account. Raises `Conflict` where it does for another one."""
    try:
        async with connection.begin_nested():
            await store.link(connection, account.person_id, identity.issuer, identity.subject)
    except IntegrityError:
        raise Conflict(said("identity_of_other")) from None
    detail = {"issuer": identity.issuer}
    await audit.record(connection, account, "oidc_linked", store.subject(account.person_id), detail, t_ms=now_ms)
