"""Shapes of alerts, of what is done about them, and of their filters."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field, model_validator

from wonderland.problems import said
from wonderland.proofs.records.fields import ID_PATTERN, MAX_TIME_MS
from wonderland_backend.alerts.kinds import KindName
from wonderland_backend.field_texts import FieldRefused
from wonderland_backend.filters import AboutQuery
from wonderland_backend.schemas import ApiModel, page_of

_ID = f"^{ID_PATTERN}$"
ActName = Literal["acknowledge", "reopen", "assign", "snooze", "note"]


class Alert(ApiModel):
    """Something that an officer must not miss, and what has become of it."""

    alert_id: str
    kind: KindName
    severity: Literal["critical", "warning", "notice"]
    t_ms: int = Field(description="When it happened")
    pad_id: str | None = None
    uav_id: str | None = None
    session_id: str | None = None
    tx_id: str | None = None
    facts: dict[str, Any] = Field(
        description="What its text needs: error_mm, action, supported (broadcast_unattributed: whether "
        "another broadcast under that name is where the drone was measured), located (stamps_contradict: whether "
        "there is an error_mm), why (as somebody else said it), code and zone_id (zone_closed), state, anchor_id, "
        "off_mm and extra_sigma_mm (pad_drifting), since_ms, who, until_ms, serial, finding, distance_mm, "
        "interval_ms, other_uav_id, drones"
    )
    text: str | None = Field(
        default=None, description="The same in one sentence, in the language asked for; not in live frames"
    )
    state: Literal["open", "acknowledged", "returned", "over"] = Field(
        description="returned: its cause ended before anybody acknowledged it; over: nobody needs to"
    )
    revision: int = Field(description="Rises with each change; name it when you act")
    changed_ms: int
    acknowledged_by: str | None = None
    assigned_to: str | None = None
    snoozed_until_ms: int | None = None
    over_ms: int | None = Field(default=None, description="When its cause ended by itself")


class AlertCount(ApiModel):
    """How many alerts wait for somebody."""

    inbox: int = Field(description="Open or returned, and not asleep")


class AlertAct(ApiModel):
    """What somebody did about an alert."""

    t_ms: int
    person: str
    act: ActName
    detail: str | None = Field(default=None, description="Whom it was assigned to, or until when (ms) it sleeps")
    note: str | None = None


class AlertDelivery(ApiModel):
    """Whether somebody outside was told."""

    target: str
    attempts: int
    delivered_ms: int | None = None
    next_ms: int | None = None
    problem: str | None = None


class AlertTold(ApiModel):
    """An alert, as it is sent to the addresses of the server’s settings (`alert_webhooks`)."""

    type: Literal["alert"]
    alert: Alert
    text: str = Field(description="The same in one sentence, in the language of the server’s settings")


class AlertDetail(ApiModel):
    """An alert with everything that was done about it."""

    alert: Alert
    acts: list[AlertAct]
    deliveries: list[AlertDelivery]


class Act(BaseModel):
    """What to do about an alert."""

    model_config = ConfigDict(extra="forbid")

    act: ActName
    revision: int = Field(ge=0, le=2**31, description="The alert's revision that you have seen")
    note: str | None = Field(default=None, min_length=1, max_length=2_000)
    assignee: str | None = Field(default=None, min_length=1, max_length=128, description="assign: yourself without it")
    until_ms: int | None = Field(default=None, ge=0, le=MAX_TIME_MS, description="snooze: until then")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if (self.act == "snooze") != (self.until_ms is not None):
            raise FieldRefused(said("fields_snooze"))
        if self.assignee is not None and self.act != "assign":
            raise FieldRefused(said("fields_assignee"))
        if self.act == "note" and self.note is None:
            raise FieldRefused(said("fields_note"))
        return self


class AlertQuery(AboutQuery):
    """What a list of alerts is narrowed by."""

    state: Literal["inbox", "snoozed", "open", "acknowledged", "returned", "over"] | None = Field(
        default=None, description="inbox: open or returned, and not asleep"
    )
    severity: Literal["critical", "warning", "notice"] | None = None
    kind: KindName | None = None
    session: str | None = Field(default=None, pattern="^[0-9a-f]{64}$")


AlertFilters = Annotated[AlertQuery, Query()]
AlertPage = page_of("AlertPage", Alert)
