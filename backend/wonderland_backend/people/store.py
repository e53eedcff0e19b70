"""People in the database. What changes them is audited in the same transaction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from sqlalchemy import Row as Columns
from sqlalchemy import delete, func, insert, or_, select, update
from sqlalchemy.exc import IntegrityError
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland.problems import said
from wonderland_backend import audit
from wonderland_backend.audit.store import take_turns
from wonderland_backend.auth.store.sign_ins import DISPLAY
from wonderland_backend.db.tables.people import LinkRow, PasskeyRow, PersonRow, SignInRow
from wonderland_backend.errors import Conflict, NotFound
from wonderland_backend.people.schemas import OF_AN_ORGANISATION, Invitation, PersonChange, misfit
from wonderland_backend.person import Account, Person, Role, roles_of

INVITED: Final = "invited"
ACTIVE: Final = "active"
SUSPENDED: Final = "suspended"

Row = dict[str, Any]

_KNOWN: Final = select(PersonRow.person_id, PersonRow.name, PersonRow.state, PersonRow.subject)


def subject(person_id: str) -> str:
    """What the audit log calls a person."""
    return f"person/{person_id}"


async def listing(database: AsyncSession | AsyncConnection) -> list[Row]:
    """All people, by name."""
    found = (await database.execute(_people().order_by(func.lower(PersonRow.name), PersonRow.person_id))).all()
    return [_shown(row) for row in found]


async def find_person(database: AsyncSession | AsyncConnection, person_id: str) -> Row:
    """One person. Raises `NotFound`."""
    row = (await database.execute(_people().where(PersonRow.person_id == person_id))).first()
    if row is None:
        raise NotFound(said("no_such_person"))
    return _shown(row)


async def of_identity(
    connection: AsyncConnection, issuer: str, subject: str
) -> Columns[str, str, str, str | None] | None:
    """Who is linked to this subject of an OpenID provider."""
    query = _KNOWN.where(PersonRow.issuer == issuer, PersonRow.subject == subject)
    return (await connection.execute(query)).first()


async def of_email(connection: AsyncConnection, email: str) -> Columns[str, str, str, str | None] | None:
    """Whose e-mail address it is."""
    return (await connection.execute(_KNOWN.where(PersonRow.email == email))).first()


async def passkeys(database: AsyncSession, person_id: str) -> list[Row]:
    """Their passkeys, oldest first."""
    columns = (PasskeyRow.credential_id, PasskeyRow.name, PasskeyRow.created_ms, PasskeyRow.last_used_ms)
    query = select(*columns).where(PasskeyRow.person_id == person_id).order_by(PasskeyRow.created_ms)
    return [_without_none(dict(row)) for row in (await database.execute(query)).mappings()]


async def sign_ins(database: AsyncSession, person_id: str, *, current: str, alive_since_ms: int, now: int) -> list[Row]:
    """Where they are signed in, the latest first. `current` is the hash of the asking browser's cookie."""
    names = ("sign_in_id", "method", "browser", "created_ms", "last_seen_ms", "expires_ms")
    query = (
        select(*(getattr(SignInRow, name) for name in names), (SignInRow.cookie_sha256 == current).label("current"))
        .where(SignInRow.person_id == person_id, SignInRow.expires_ms > now)
        .where(or_(SignInRow.last_seen_ms > alive_since_ms, SignInRow.method == DISPLAY))
        .order_by(SignInRow.last_seen_ms.desc())
    )
    return [dict(row) | {"current": bool(row["current"])} for row in (await database.execute(query)).mappings()]


async def create(
    connection: AsyncConnection, who: Person | Account, wanted: Invitation, person_id: str, *, state: str, now_ms: int
) -> None:
    """A new account. Raises `Conflict` where the e-mail address is somebody's already."""
    row = {
        "person_id": person_id,
        "name": wanted.name,
        "email": wanted.email,
        "roles": " ".join(wanted.roles),
        "msp_id": wanted.msp_id,
        "state": state,
        "created_ms": now_ms,
        "changed_ms": now_ms,
        "revision": 0,
    }
    try:
        async with connection.begin_nested():
            await connection.execute(insert(PersonRow), [row])
    except IntegrityError:
        raise Conflict(said("email_taken")) from None
    detail = {"name": wanted.name, "roles": list(wanted.roles), "msp_id": wanted.msp_id}
    await audit.record(connection, who, f"person_{state}", subject(person_id), detail, t_ms=now_ms)


async def change(
    connection: AsyncConnection, who: Person | str, person_id: str, wanted: PersonChange, now_ms: int, reason: str = ""
) -> tuple[Row, list[str]]:
    """Change a person; the hashes of the sign-ins that ended or see something else now.

    `who` is a text where the server's own administrator does it, who gives a reason.

    Raises `NotFound`, and `Conflict` for a change that somebody else made meanwhile, an address that is taken, a
    suspension of oneself, or the loss of the last administrator.
    """
    # Two administrators who demote each other at once would leave none.
    await take_turns(connection)
    before = await find_person(connection, person_id)
    values = wanted.model_dump(exclude_none=True, exclude={"revision"})
    _check(before, values, by_oneself=isinstance(who, Person) and who.person_id == person_id)
    roles: Sequence[Role] = values.get("roles") or before["roles"]
    if before["state"] == ACTIVE and (values.get("state") == SUSPENDED or "admin" not in roles):
        await _keep_an_administrator(connection, person_id)
    stored = dict(values)
    if "roles" in stored:
        stored["roles"] = " ".join(stored["roles"])
    if stored.get("email") == "":
        stored["email"] = None
    try:
        async with connection.begin_nested():
            done = await connection.execute(
                update(PersonRow)
                .where(PersonRow.person_id == person_id, PersonRow.revision == wanted.revision)
                .values(**stored, changed_ms=now_ms, revision=wanted.revision + 1)
            )
    except IntegrityError:
        raise Conflict(said("email_taken")) from None
    if done.rowcount != 1:
        raise Conflict(said("account_changed"))
    touched: list[str] = []
    if {"roles", "msp_id", "state"} & values.keys():
        theirs = select(SignInRow.cookie_sha256).where(SignInRow.person_id == person_id)
        touched = list((await connection.execute(theirs)).scalars())
    if values.get("state") == SUSPENDED:
        await end_all(connection, person_id)
    act = {SUSPENDED: "person_suspended", ACTIVE: "person_restored"}.get(values.get("state", ""), "person_changed")
    was = {name: before.get(name, "") for name in values}
    detail = {"to": values, "from": was} | ({"reason": reason} if reason else {})
    await audit.record(connection, who, act, subject(person_id), detail, t_ms=now_ms)
    return await find_person(connection, person_id), touched


async def withdraw(connection: AsyncConnection, who: Person, person_id: str, now_ms: int) -> None:
    """Take an invitation back. Raises `NotFound`, and `Conflict` for somebody who has accepted it."""
    before = await find_person(connection, person_id)
    if before["state"] != INVITED:
        raise Conflict(said("invitation_accepted"))
    await connection.execute(delete(PersonRow).where(PersonRow.person_id == person_id))
    await audit.record(
        connection, who, "invitation_withdrawn", subject(person_id), {"name": before["name"]}, t_ms=now_ms
    )


async def end_all(connection: AsyncConnection, person_id: str) -> None:
    """End all sign-ins of a person, and the links that would let somebody in as them."""
    await connection.execute(delete(SignInRow).where(SignInRow.person_id == person_id))
    await connection.execute(delete(LinkRow).where(LinkRow.person_id == person_id, LinkRow.used_ms.is_(None)))


async def end_sign_in(connection: AsyncConnection, who: Person, person_id: str, sign_in_id: str, now_ms: int) -> str:
    """End one sign-in; the hash of its cookie. Raises `NotFound`."""
    mine = (SignInRow.person_id == person_id, SignInRow.sign_in_id == sign_in_id)
    found = (await connection.execute(select(SignInRow.cookie_sha256).where(*mine))).scalar_one_or_none()
    if found is None:
        raise NotFound(said("sign_in_ended"))
    await connection.execute(delete(SignInRow).where(*mine))
    await audit.record(connection, who, "sign_in_ended", subject(person_id), {"sign_in": sign_in_id}, t_ms=now_ms)
    return str(found)


async def rename_passkey(connection: AsyncConnection, who: Person, credential_id: str, name: str, now_ms: int) -> None:
    """Raises `NotFound`."""
    mine = (PasskeyRow.person_id == who.person_id, PasskeyRow.credential_id == credential_id)
    done = await connection.execute(update(PasskeyRow).where(*mine).values(name=name))
    if done.rowcount != 1:
        raise NotFound(said("no_such_passkey"))
    await audit.record(connection, who, "passkey_renamed", subject(who.person_id), {"name": name}, t_ms=now_ms)


async def remove_passkey(connection: AsyncConnection, who: Person, credential_id: str, now_ms: int) -> None:
    """Raises `NotFound`, and `Conflict` for the last sign-in method."""
    person = await find_person(connection, who.person_id)
    mine = (PasskeyRow.person_id == who.person_id, PasskeyRow.credential_id == credential_id)
    name = (await connection.execute(select(PasskeyRow.name).where(*mine))).scalar_one_or_none()
    if name is None:
        raise NotFound(said("no_such_passkey"))
    if person["passkeys"] == 1 and not person["oidc"]:
        raise Conflict(said("last_sign_in_method"))
    await connection.execute(delete(PasskeyRow).where(*mine))
    await audit.record(connection, who, "passkey_removed", subject(who.person_id), {"name": name}, t_ms=now_ms)


async def set_roles(connection: AsyncConnection, account: Account, roles: Sequence[Role], now_ms: int) -> None:
    """The provider's groups say what somebody is. The last administrator stays one all the same."""
    before = await find_person(connection, account.person_id)
    if list(roles) == before["roles"]:
        return
    if (
        "admin" in before["roles"]
        and "admin" not in roles
        and not await _other_administrator(connection, account.person_id)
    ):
        return
    await connection.execute(
        update(PersonRow)
        .where(PersonRow.person_id == account.person_id)
        .values(roles=" ".join(roles), changed_ms=now_ms, revision=PersonRow.revision + 1)
    )
    detail = {"to": {"roles": list(roles)}, "from": {"roles": before["roles"]}, "by": "oidc"}
    await audit.record(connection, account, "person_changed", subject(account.person_id), detail, t_ms=now_ms)


def _check(before: Row, values: Row, *, by_oneself: bool) -> None:
    if by_oneself and ("state" in values or "roles" in values):
        raise Conflict(said("not_oneself"))
    if "state" in values and before["state"] == INVITED:
        raise Conflict(said("invitation_not_accepted"))
    roles: Sequence[Role] = values.get("roles") or before["roles"]
    if not OF_AN_ORGANISATION.isdisjoint(roles) and not values.get("msp_id", before.get("msp_id", "")):
        raise Conflict(said("organisation_needed"))
    if {"roles", "msp_id"} & values.keys():
        why = misfit(roles, str(values.get("msp_id", before.get("msp_id", ""))))
        if why is not None:
            raise Conflict(why)


async def _keep_an_administrator(connection: AsyncConnection, person_id: str) -> None:
    person = await find_person(connection, person_id)
    if "admin" in person["roles"] and not await _other_administrator(connection, person_id):
        raise Conflict(said("last_administrator"))


async def _other_administrator(connection: AsyncConnection, person_id: str) -> bool:
    query = select(PersonRow.roles).where(PersonRow.state == ACTIVE, PersonRow.person_id != person_id)
    return any("admin" in roles_of(text) for text in (await connection.execute(query)).scalars())


def _people() -> Any:
    count = select(func.count()).where(PasskeyRow.person_id == PersonRow.person_id).scalar_subquery()
    seen = select(func.max(SignInRow.last_seen_ms)).where(SignInRow.person_id == PersonRow.person_id).scalar_subquery()
    return select(PersonRow.__table__, count.label("passkeys"), seen.label("last_seen_ms"))


def _shown(row: Any) -> Row:
    return _without_none(
        {
            "person_id": row.person_id,
            "name": row.name,
            "email": row.email,
            "roles": list(roles_of(row.roles)),
            "msp_id": row.msp_id or None,
            "state": row.state,
            "passkeys": row.passkeys,
            "oidc": row.subject is not None,
            "created_ms": row.created_ms,
            "last_seen_ms": row.last_seen_ms,
            "revision": row.revision,
        }
    )


def _without_none(row: Row) -> Row:
    return {name: value for name, value in row.items() if value is not None}


async def is_anybody_active(connection: AsyncConnection) -> bool:
    """Whether the server has been set up."""
    query = select(PersonRow.person_id).where(PersonRow.state == ACTIVE).limit(1)
    return (await connection.execute(query)).first() is not None


async def active(connection: AsyncConnection) -> Sequence[Columns[str, str, str]]:
    """Everybody who is active: id, name, roles."""
    query = select(PersonRow.person_id, PersonRow.name, PersonRow.roles).where(PersonRow.state == ACTIVE)
    return (await connection.execute(query)).all()


async def activate(connection: AsyncConnection, person_id: str, now_ms: int) -> None:
    """From invited to active."""
    await connection.execute(
        update(PersonRow)
        .where(PersonRow.person_id == person_id)
        .values(state=ACTIVE, changed_ms=now_ms, revision=PersonRow.revision + 1)
    )


async def link(connection: AsyncConnection, person_id: str, issuer: str, subject: str) -> None:
    """The provider vouches for them. Raises `IntegrityError` where it does for somebody else."""
    await connection.execute(
        update(PersonRow).where(PersonRow.person_id == person_id).values(issuer=issuer, subject=subject)
    )


async def forget_methods(connection: AsyncConnection, person_id: str) -> None:
    """Whoever comes back by a link has no passkey, and no provider that vouches for them."""
    await connection.execute(delete(PasskeyRow).where(PasskeyRow.person_id == person_id))
    await connection.execute(
        update(PersonRow).where(PersonRow.person_id == person_id).values(issuer=None, subject=None)
    )
