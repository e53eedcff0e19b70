"""Step-up: what weighs most is asked for once more, by a passkey, of the person who is at the keys now.

An endpoint declares it (`wonderland_backend.proved`) and knows nothing else of it. What is fresh is bound to the
signed-in browser and to one request (method, path and body are in the challenge that the passkey signs), and is spent.
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from http import HTTPStatus
from typing import Any, Final

from fastapi import Request
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland.problems import Said, said
from wonderland_backend import audit
from wonderland_backend.auth import passkeys
from wonderland_backend.auth.store import ceremonies, sign_ins
from wonderland_backend.auth.store import passkeys as passkey_store
from wonderland_backend.context import Context
from wonderland_backend.errors import Problem, SignInRequired
from wonderland_backend.person import Person

HEADER: Final = "Step-Up"
RECENT_MS: Final = 15 * 60_000
"""So old an assertion may be for what is urgent."""
SPENT_WITHIN_MS: Final = 2 * 60_000
ASKED: Final = "step-up"
GRANTED: Final = "step-up-grant"
PARAMETER: Final[dict[str, Any]] = {
    "name": HEADER,
    "in": "header",
    "required": False,
    "description": "From `POST /api/v1/step-up`: good once, for this very request, within two minutes.",
    "schema": {"type": "string", "minLength": 1, "maxLength": 128},
    "example": "8bqEJ2k0d3p1m5X7cVt9yQhRzLwUa4sNfGiOeKjTbMo",
}
DOCUMENTED: Final[dict[str, Any]] = {"parameters": [PARAMETER]}
"""For an operation that has no other header."""


class StepUpRequired(Problem):
    """It needs a fresh assertion of a passkey: `POST /api/v1/step-up/challenge` asks for one, then try again."""

    status, code = HTTPStatus.FORBIDDEN, "step-up-required"
    example = said("step_up_needed", header=HEADER)


class NoPasskey(Problem):
    """The account has no passkey to assert."""

    status, code = HTTPStatus.CONFLICT, "no-passkey"
    example = said("step_up_no_passkey")


@dataclass(frozen=True)
class Act:
    """The one request that an assertion is for."""

    method: str
    path: str
    body_sha256: str

    @classmethod
    async def of(cls, request: Request) -> Act:
        """What is asked for now."""
        return cls(request.method, request.url.path, hashlib.sha256(await request.body()).hexdigest())

    def challenge(self, nonce: bytes) -> bytes:
        """What a passkey signs: an assertion for another request does not fit."""
        return hashlib.sha256(b"\0".join((nonce, *(each.encode() for each in asdict(self).values())))).digest()


async def ask(context: Context, connection: AsyncConnection, person: Person, act: Act) -> dict[str, Any]:
    """What to hand to the browser's authenticator. Raises `NoPasskey`."""
    known = await passkey_store.ids_of(connection, person.person_id)
    if not known:
        raise NoPasskey(said("step_up_no_passkey"))
    kept = {"person_id": person.person_id, "cookie_sha256": person.cookie_sha256, **asdict(act)}
    challenge = act.challenge(context.randomness(32))
    return await passkeys.ask_to_sign_in(context, connection, kind=ASKED, challenge=challenge, allowed=known, more=kept)


async def grant(context: Context, person: Person, ceremony: str, credential: dict[str, Any], host: str) -> str:
    """The token that lets the one request pass. Raises `CeremonyOver`, `StepUpRequired`."""
    asked = await passkeys.asked_for(context, ASKED, ceremony)
    act = Act(asked["method"], asked["path"], asked["body_sha256"])
    async with context.database.write() as connection:
        why = await _why_not(context, connection, person, asked, credential, host)
        now = context.clock()
        subject, about = f"person/{person.person_id}", {"request": f"{act.method} {act.path}"}
        if why is not None:
            await audit.record(connection, person, "step_up_failed", subject, about | {"why": str(why)}, t_ms=now)
        else:
            await audit.record(connection, person, "step_up", subject, about, t_ms=now)
            await sign_ins.note_verified(connection, person.cookie_sha256, now)
            kept = {"cookie_sha256": person.cookie_sha256, "granted_ms": now, **asdict(act)}
            return await ceremonies.begin(connection, GRANTED, kept, now_ms=now, randomness=context.randomness)
    raise StepUpRequired(why)


async def _why_not(
    context: Context,
    connection: AsyncConnection,
    person: Person,
    asked: dict[str, Any],
    credential: dict[str, Any],
    host: str,
) -> Said | None:
    if (asked["person_id"], asked["cookie_sha256"]) != (person.person_id, person.cookie_sha256):
        return said("step_up_of_other")
    try:
        async with connection.begin_nested():
            owner = await passkeys.verify(context, connection, asked, credential, host=host)
    except SignInRequired as refused:
        return refused.said
    return None if owner == person.person_id else said("step_up_of_other")


async def require_fresh(request: Request, context: Context, person: Person) -> None:
    """Spend the assertion that was made for this very request. Raises `StepUpRequired`."""
    if _is_exempt(context, person):
        return
    token = request.headers.get(HEADER)
    if token is None:
        request.state.audited = True  # the question is no refusal: it is asked of everybody
        raise StepUpRequired(said("step_up_needed", header=HEADER))
    async with context.database.write() as connection:
        found = await ceremonies.finish(connection, GRANTED, token, context.clock())
    if found is None or found["granted_ms"] + SPENT_WITHIN_MS <= context.clock():
        raise StepUpRequired(said("step_up_spent"))
    wanted = {"cookie_sha256": person.cookie_sha256, **asdict(await Act.of(request))}
    if {name: found[name] for name in wanted} != wanted:
        raise StepUpRequired(said("step_up_of_other"))


async def require_recent(request: Request, context: Context, person: Person) -> None:
    """The same, or an assertion of this sign-in that is younger than `RECENT_MS`. Raises `StepUpRequired`."""
    if context.clock() - person.verified_ms >= RECENT_MS:
        await require_fresh(request, context, person)


async def require_for_new_passkey(request: Request, context: Context, person: Person) -> None:
    """For the first passkey of somebody who came by a link or the provider just now, that is the proof."""
    async with context.database.read() as session:
        has_one = bool(await passkey_store.ids_of(await session.connection(), person.person_id))
    just_now = person.method in {"link", "oidc"} and context.clock() - person.signed_in_ms < RECENT_MS
    if has_one or not just_now:
        await require_fresh(request, context, person)


def _is_exempt(context: Context, person: Person) -> bool:
    """A demo's visitor comes by a link, at an address that can have no passkeys, on this machine only."""
    return context.settings.demo and person.method == "link"
