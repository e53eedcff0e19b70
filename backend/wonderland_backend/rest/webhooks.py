"""Subscriptions by REST: each sees and changes its own; administrators see all."""

from __future__ import annotations

from typing import Annotated, Any, Final

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland.problems import said
from wonderland_backend import audit
from wonderland_backend.access import SignedInPerson, require
from wonderland_backend.auth import step_up
from wonderland_backend.auth.step_up import StepUpRequired
from wonderland_backend.clients import idempotency
from wonderland_backend.clients.machines import METHOD, MachinesDep
from wonderland_backend.context import Context, ContextDep
from wonderland_backend.db.tables.webhooks import SubscriptionRow
from wonderland_backend.errors import (
    BadRequest,
    Conflict,
    Forbidden,
    NotFound,
    PreconditionFailed,
    SwitchedOff,
    TooManyRequests,
    Unprocessable,
    documented,
)
from wonderland_backend.events import queries as feed
from wonderland_backend.events.queries import Place
from wonderland_backend.filters import Paging
from wonderland_backend.http.targets import TargetRefused
from wonderland_backend.person import Person
from wonderland_backend.responses import Json, etag_of, page, require_match, resource
from wonderland_backend.webhooks import signing, store, trying
from wonderland_backend.webhooks.post import PosterDep
from wonderland_backend.webhooks.schemas import (
    ChangedSubscription,
    DeliveryFilters,
    DeliveryPage,
    NewSubscription,
    Subscription,
    SubscriptionCreated,
    SubscriptionPage,
    WebhookDelivery,
    WebhookTest,
)
from wonderland_backend.webhooks.sealing import Sealing, SealingDep

router = APIRouter(tags=["subscriptions"])
_NOT_FOUND: Final = NotFound(said("no_such_subscription"))
MAX_EACH: Final = 20
TESTS_PER_MIN: Final = 6
SubscriptionIdPath = Annotated[str, Path(pattern="^[0-9a-f]{32}$")]
DeliveryIdPath = Annotated[str, Path(pattern="^[0-9a-f]{32}$")]
NO_STORE: Final = {"Cache-Control": "private, no-store"}
_BAD_URL: Final = Unprocessable(
    said("bad_url", why=said("target_private", host="10.0.0.7")), ("body.url", said("target_private", host="10.0.0.7"))
)
_ONCE: Final[dict[str, Any]] = {"parameters": [idempotency.PARAMETER]}


@router.get("/subscriptions", response_model=SubscriptionPage, responses=documented(BadRequest, etag=True))
async def list_subscriptions(request: Request, context: ContextDep, paging: Paging, person: SignedInPerson) -> Response:
    """One's own webhooks; an administrator sees all."""
    after = paging.after_key(str)
    owner = None if person.has("admin") else person.person_id
    async with context.database.read() as database:
        rows = await store.listing(database, owner=owner, after=after, limit=paging.limit + 1)
    return page(
        request,
        ((row, store.subscription_json(row)) for row in rows),
        paging.limit,
        cursor_of=lambda row: (row.subscription_id,),
    )


@router.post(
    "/subscriptions",
    status_code=201,
    response_model=SubscriptionCreated,
    responses=documented(
        idempotency.BAD_KEY,
        Forbidden,
        StepUpRequired,
        Conflict(said("subscriptions_full", most=MAX_EACH)),
        SwitchedOff(said("webhooks_need_a_key")),
        _BAD_URL,
    ),
    openapi_extra={"parameters": [idempotency.PARAMETER, step_up.PARAMETER]},
)
async def add_subscription(
    request: Request,
    context: ContextDep,
    poster: PosterDep,
    sealing: SealingDep,
    body: NewSubscription,
    person: SignedInPerson,
) -> Response:
    """Have events sent to a URL, signed with the secret in the answer.

    Check what comes as the Standard Webhooks specification says (https://www.standardwebhooks.com), by a library of it
    or by `wonderland.client.verify_webhook`.
    """
    if person.method != METHOD:
        require(person, "admin", "inspector", "pad_operator", "fleet_operator")
        await step_up.require_recent(request, context, person)  # it outlives the sign-in
    if not sealing.is_possible:
        raise SwitchedOff(said("webhooks_need_a_key"))

    async def write() -> Response:
        try:
            await poster.target(body.url)
        except TargetRefused as refused:
            raise Unprocessable(said("bad_url", why=refused), ("body.url", refused.said)) from None
        return await _add(context, sealing, body, person)

    return await idempotency.once(request, person, write)


async def _add(context: Context, sealing: Sealing, body: NewSubscription, person: Person) -> Response:
    async with context.database.read() as database:
        after = Place.parse(body.after) if body.after is not None else await feed.tip(database)
    secret = signing.new_secret(context.randomness)
    subscription_id = context.randomness(16).hex()
    row = {
        "subscription_id": subscription_id,
        "owner": person.person_id,
        "name": body.name,
        "url": body.url,
        "secret": sealing.seal(secret, subscription_id),
        "filter": store.filter_text(body.filter()),
        "state": store.ACTIVE,
        "block": after.block,
        "tx_index": after.tx_index,
        "created_ms": context.clock(),
    }
    async with context.database.write() as connection:
        if await store.count_of(connection, person.person_id) >= MAX_EACH:
            raise Conflict(said("subscriptions_full", most=MAX_EACH))
        await store.add(connection, row)
        subject = f"subscription/{subscription_id}"
        await audit.record(connection, person, "add_subscription", subject, {"url": body.url}, t_ms=context.clock())
    content = {"subscription": store.subscription_json(SubscriptionRow(**row)), "secret": secret}
    return Json(content, 201, NO_STORE | {"Location": f"/api/v1/subscriptions/{subscription_id}"})


@router.get(
    "/subscriptions/{subscription_id}", response_model=Subscription, responses=documented(_NOT_FOUND, etag=True)
)
async def read_subscription(
    request: Request, context: ContextDep, subscription_id: SubscriptionIdPath, person: SignedInPerson
) -> Response:
    """A webhook."""
    async with context.database.read() as database:
        row = await _theirs(database, subscription_id, person)
    return resource(request, store.subscription_json(row))


@router.patch(
    "/subscriptions/{subscription_id}",
    response_model=Subscription,
    responses=documented(Forbidden, _NOT_FOUND, PreconditionFailed),
)
async def change_subscription(
    request: Request,
    context: ContextDep,
    subscription_id: SubscriptionIdPath,
    body: ChangedSubscription,
    person: SignedInPerson,
) -> Response:
    """Pause a webhook, or have it go on where it was."""
    async with context.database.write() as connection:
        await _to_change(request, connection, subscription_id, person)
        await store.set_state(connection, subscription_id, body.state)
        subject = f"subscription/{subscription_id}"
        await audit.record(connection, person, f"{body.state}_subscription", subject, t_ms=context.clock())
    async with context.database.read() as database:
        shown = store.subscription_json(await _theirs(database, subscription_id, person))
    return Json(shown, headers=NO_STORE | {"ETag": etag_of(shown)})


@router.delete(
    "/subscriptions/{subscription_id}", status_code=204, responses=documented(Forbidden, _NOT_FOUND, PreconditionFailed)
)
async def remove_subscription(
    request: Request, context: ContextDep, subscription_id: SubscriptionIdPath, person: SignedInPerson
) -> Response:
    """End a webhook; what still waits to be delivered is dropped."""
    async with context.database.write() as connection:
        await _to_change(request, connection, subscription_id, person)
        await store.remove(connection, subscription_id)
        subject = f"subscription/{subscription_id}"
        await audit.record(connection, person, "remove_subscription", subject, t_ms=context.clock())
    return Response(status_code=204)


@router.get(
    "/subscriptions/{subscription_id}/deliveries",
    response_model=DeliveryPage,
    responses=documented(BadRequest, _NOT_FOUND, etag=True),
)
async def list_deliveries(
    request: Request,
    context: ContextDep,
    subscription_id: SubscriptionIdPath,
    filters: DeliveryFilters,
    person: SignedInPerson,
) -> Response:
    """What was sent, what waits, and what was given up (`state=dead`), newest first; kept for two weeks."""
    place = filters.after_place(int, str)
    before = (place[0], place[1]) if place is not None else None
    async with context.database.read() as database:
        await _theirs(database, subscription_id, person)
        rows = await store.deliveries(
            database, subscription_id, state=filters.state, before=before, limit=filters.limit + 1
        )
    return page(
        request,
        ((row, store.delivery_json(row)) for row in rows),
        filters.limit,
        cursor_of=lambda row: (row.created_ms, row.delivery_id),
    )


@router.post(
    "/subscriptions/{subscription_id}/deliveries/{delivery_id}/redeliver",
    status_code=202,
    response_model=WebhookDelivery,
    responses=documented(
        idempotency.BAD_KEY,
        Forbidden,
        NotFound(said("no_such_delivery")),
        idempotency.BUSY,
        Unprocessable,
    ),
    openapi_extra=_ONCE,
)
async def redeliver(
    request: Request,
    context: ContextDep,
    subscription_id: SubscriptionIdPath,
    delivery_id: DeliveryIdPath,
    person: SignedInPerson,
) -> Response:
    """Send a delivery once more, with the same `webhook-id`."""

    async def write() -> Response:
        async with context.database.read() as database:
            await _theirs(database, subscription_id, person)
            row = await store.delivery(database, delivery_id)
        if row is None or row.subscription_id != subscription_id:
            raise NotFound(said("no_such_delivery"))
        async with context.database.write() as connection:
            await store.again(connection, delivery_id, context.clock())
        async with context.database.read() as database:
            row = await store.delivery(database, delivery_id)
        assert row is not None
        return Json(store.delivery_json(row), 202, NO_STORE)

    return await idempotency.once(request, person, write)


@router.post(
    "/subscriptions/{subscription_id}/test",
    response_model=WebhookTest,
    responses=documented(Forbidden, _NOT_FOUND, TooManyRequests),
)
async def try_webhook(
    context: ContextDep,
    poster: PosterDep,
    sealing: SealingDep,
    machines: MachinesDep,
    subscription_id: SubscriptionIdPath,
    person: SignedInPerson,
) -> Response:
    """Send a signed event of type `webhook.test` now, also while it is paused, and see what comes back.

    Six times a minute at most. The receiver’s answer is told by its status, not by its content.
    """
    async with context.database.read() as database:
        row = await _theirs(database, subscription_id, person)
    allowance = machines.limits.count(f"webhook tests of {person.person_id}", TESTS_PER_MIN)
    if allowance.exceeded:
        wait_s = allowance.reset_s
        detail = said("too_many_requests", quota=TESTS_PER_MIN, wait_s=wait_s)
        raise TooManyRequests(detail, headers={"Retry-After": str(wait_s)})
    found = await trying.try_out(context, poster, sealing, row)
    async with context.database.write() as connection:
        subject = f"subscription/{subscription_id}"
        outcome: dict[str, Any] = {name: found[name] for name in ("arrived", "status") if name in found}
        await audit.record(connection, person, "test_subscription", subject, outcome, t_ms=context.clock())
    return Json(found, headers=NO_STORE)


async def _to_change(request: Request, connection: AsyncConnection, subscription_id: str, person: Person) -> None:
    """Hold theirs until it is changed, if it is what they saw. Raises `NotFound`, `PreconditionFailed`."""
    await store.hold(connection, subscription_id)
    async with AsyncSession(connection) as database:
        require_match(request, store.subscription_json(await _theirs(database, subscription_id, person)))


async def _theirs(database: AsyncSession, subscription_id: str, person: Person) -> SubscriptionRow:
    """Raises `NotFound` for what is not theirs, too."""
    row = await store.find_subscription(database, subscription_id)
    if row is None or (row.owner != person.person_id and not person.has("admin")):
        raise NotFound(said("no_such_subscription"))
    return row
