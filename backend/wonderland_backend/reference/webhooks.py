"""What receivers of webhooks are sent, for the description's section `webhooks`; nothing is served there."""

from __future__ import annotations

from typing import Annotated, Any, Final

from fastapi import APIRouter, Header

from wonderland_backend.alerts.schemas import AlertTold
from wonderland_backend.events.schemas import LedgerEvent
from wonderland_backend.proof_requests.schemas import ProofRequestCreated
from wonderland_backend.webhooks.schemas import WebhookTestEvent

_Id = Annotated[str, Header(description="The same when it is sent again: do nothing a second time")]
_Timestamp = Annotated[int, Header(description="Seconds; refuse one more than five minutes off")]
_Signature = Annotated[
    str, Header(description="`v1,` and base64 of HMAC-SHA256 over `id.timestamp.body`, by the secret")
]
_ROUTE: Final[dict[str, Any]] = {"status_code": 204, "openapi_extra": {"security": []}}


def describe(to: APIRouter) -> None:
    """One entry for each form of message, under the name by which a receiver tells them apart: `type`."""

    @to.post("event", operation_id="receive_event", **_ROUTE)
    async def receive_event(
        body: LedgerEvent, webhook_id: _Id, webhook_timestamp: _Timestamp, webhook_signature: _Signature
    ) -> None:
        """Something was committed to the ledger. Answer 2xx within ten seconds; else it is sent again for three days.

        Signed as the Standard Webhooks specification says (https://www.standardwebhooks.com).
        """

    @to.post("proof_request.created", operation_id="receive_proof_request", **_ROUTE)
    async def receive_proof_request(
        body: ProofRequestCreated, webhook_id: _Id, webhook_timestamp: _Timestamp, webhook_signature: _Signature
    ) -> None:
        """Somebody asks that a drone proves its location; only to subscriptions that name this type."""

    @to.post("webhook.test", operation_id="receive_test", **_ROUTE)
    async def receive_test(
        body: WebhookTestEvent, webhook_id: _Id, webhook_timestamp: _Timestamp, webhook_signature: _Signature
    ) -> None:
        """Somebody tries the webhook (`try_webhook`); to every subscription, whatever it names."""

    @to.post("alert", operation_id="receive_alert", **_ROUTE)
    async def receive_alert(
        body: AlertTold, webhook_id: _Id, webhook_timestamp: _Timestamp, webhook_signature: _Signature
    ) -> None:
        """An alert, to the addresses in the server’s settings, signed with the secret there."""
