"""Shapes of subscriptions and deliveries."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field

from wonderland.proofs.records.fields import ID_PATTERN
from wonderland_backend.events.queries import PATTERN, Filter
from wonderland_backend.events.schemas import EventType
from wonderland_backend.filters import PageQuery
from wonderland_backend.http.targets import MAX_URL
from wonderland_backend.schemas import ApiModel, page_of

_Pad = Annotated[str, Field(pattern=f"^{ID_PATTERN}$", max_length=64)]
_Drone = Annotated[str, Field(pattern=f"^{ID_PATTERN}$", max_length=40)]
Outcome = Literal["verified", "refuted", "inconclusive"]


class NewSubscription(BaseModel):
    """What to be told of, and where."""

    model_config = ConfigDict(extra="forbid")

    url: str = Field(min_length=1, max_length=MAX_URL, description="https://…")
    name: str = Field(
        default="", max_length=120, description="For people, to tell it from others", examples=["Situation room"]
    )
    types: list[EventType] = Field(
        default_factory=list, max_length=32, description="Types of events; none: all", examples=[["ProofDecided"]]
    )
    pads: list[_Pad] = Field(default_factory=list, max_length=100, description="Only events of these pads; none: all")
    drones: list[_Drone] = Field(default_factory=list, max_length=100, description="Only of these drones; none: all")
    outcomes: list[Outcome] = Field(default_factory=list, max_length=3, description="Only verdicts with these")
    after: str | None = Field(
        default=None,
        pattern=PATTERN,
        description="Begin after this event; 0.0: with the first one; none: with new ones",
    )

    def filter(self) -> Filter:
        """What the feed filters by."""
        return Filter(frozenset(self.types), frozenset(self.pads), frozenset(self.drones), frozenset(self.outcomes))


class ChangedSubscription(BaseModel):
    """Pause, or go on."""

    model_config = ConfigDict(extra="forbid")

    state: Literal["active", "paused"]


class Subscription(ApiModel):
    """A webhook."""

    subscription_id: str
    owner: str
    name: str
    url: str
    types: list[str]
    pads: list[str]
    drones: list[str]
    outcomes: list[Outcome]
    state: Literal["active", "paused"] = Field(description="While it is paused nothing is lost: it goes on from there")
    after: str = Field(description="Up to this event deliveries have been made")
    created_ms: int


class SubscriptionCreated(ApiModel):
    """A new webhook, and the secret that signs what it gets: shown this once."""

    subscription: Subscription
    secret: str = Field(description="As in the Standard Webhooks specification: whsec_ and base64")


class TriedWebhook(ApiModel):
    """Which webhook is tried."""

    subscription_id: str


class WebhookTestEvent(ApiModel):
    """Nothing has happened: somebody tries a webhook. Answer it as all others, and do nothing else."""

    id: str = Field(description="Of this test alone")
    type: Literal["webhook.test"]
    t_ms: int
    record: TriedWebhook


class WebhookHeaders(ApiModel):
    """The headers of the Standard Webhooks specification."""

    model_config = ConfigDict(validate_by_name=True)

    webhook_id: str = Field(alias="webhook-id")
    webhook_timestamp: str = Field(alias="webhook-timestamp", examples=["1800000000"])
    webhook_signature: str = Field(
        alias="webhook-signature", examples=["v1,K5oZfzN95Z9UVu1EsfQmfVNQhnkZ2pj9o9NDN/H/pI4="]
    )


class WebhookTest(ApiModel):
    """What was sent to try a webhook, and what came back. It is not tried again, and no delivery."""

    arrived: bool = Field(description="The receiver answered 2xx")
    status: int | None = Field(default=None, description="What it answered, if it did")
    problem: str | None = Field(default=None, description="Why it did not arrive")
    took_ms: int
    url: str
    headers: WebhookHeaders | None = Field(default=None, description="None where its secret cannot be read")
    body: str = Field(description="The very bytes that were signed, as text: a WebhookTestEvent")


class WebhookDelivery(ApiModel):
    """A message to a subscriber."""

    delivery_id: str = Field(description="The `webhook-id` of its requests")
    event_id: str
    type: str
    state: Literal["waiting", "delivered", "dead"]
    created_ms: int
    attempts: int
    next_ms: int | None = Field(default=None, description="When it is tried again")
    delivered_ms: int | None = None
    status: int | None = Field(default=None, description="What the receiver answered last")
    problem: str | None = None


class DeliveryQuery(PageQuery):
    """What a subscription's deliveries are narrowed by."""

    state: Literal["waiting", "delivered", "dead"] | None = None


DeliveryFilters = Annotated[DeliveryQuery, Query()]
SubscriptionPage = page_of("SubscriptionPage", Subscription)
DeliveryPage = page_of("WebhookDeliveryPage", WebhookDelivery)
