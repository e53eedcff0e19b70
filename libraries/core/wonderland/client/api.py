"""The API, method by method. Times are milliseconds since the Unix epoch, positions degrees × 10⁷, lengths mm."""

from __future__ import annotations

import json
import time
import uuid
from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Any, BinaryIO, Final, Literal, Self, TypeVar, cast

import httpx

from wonderland.client import types
from wonderland.client.errors import ApiError, Unreachable
from wonderland.client.transport import Transport

PAUSE_S: Final = 3.0
UNAUTHORIZED: Final = 401
Item = TypeVar("Item")


class Wonderland:
    """A server's API, for one client. Use it as a context manager, or call `close`.

    Its methods raise `ApiError` where the server refuses, `TokenError` where the credentials are not good, and
    `Unreachable` where there is no answer. A list is an iterator over all pages. `filters` are the query parameters
    that the reference page of the server names.
    """

    def __init__(
        self,
        url: str,
        client_id: str,
        client_secret: str | None = None,
        *,
        certificate: tuple[str, str] | None = None,
        scope: str | None = None,
        language: str = "en",
        http: httpx.Client | None = None,
    ) -> None:
        """`client_secret`, or a TLS `certificate` (its file and its key's, PEM), or both: then tokens are bound to it.

        `scope`: those asked for, all that the client may have without it. `http`: one of your own settings.
        """
        if client_secret is None and certificate is None and http is None:
            raise ValueError("a client_secret or a certificate is needed")
        self._http = http or _http(certificate)
        self._http.base_url = httpx.URL(url.rstrip("/"))
        self._http.headers["Accept-Language"] = language
        self._transport = Transport(self._http, client_id, client_secret, scope=scope)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections to the server."""
        self._http.close()

    def conformance(self, serial: str, **question: int) -> types.Conformance:
        """Whether a proof supports where a drone says that it is."""
        return cast("types.Conformance", self._get("/conformance", serial=serial, **question))

    def proofs(self, **filters: Any) -> Iterator[types.Proof]:
        """Proofs, newest first, page by page as they are read."""
        return self._pages("/proofs", filters, types.Proof)

    def proof(self, proof_id: str) -> types.Proof:
        """One proof."""
        return cast("types.Proof", self._get(f"/proofs/{proof_id}"))

    def proof_statement(self, proof_id: str) -> str:
        """One proof as its server signed it (JWS), to be shown to others: `wonderland evidence statement` checks it."""
        accept = {"Accept": "application/jose"}
        return cast("str", self._transport.request("GET", f"/proofs/{proof_id}", headers=accept))

    def sessions(self, **filters: Any) -> Iterator[types.SessionSummary]:
        """Sessions, newest first, page by page as they are read."""
        return self._pages("/sessions", filters, types.SessionSummary)

    def pads(self, **filters: Any) -> Iterator[types.Pad]:
        """Landing pads by identifier, page by page as they are read."""
        return self._pages("/pads", filters, types.Pad)

    def drones(self, **filters: Any) -> Iterator[types.Drone]:
        """Drones by serial number, page by page as they are read."""
        return self._pages("/drones", filters, types.Drone)

    def flights(self, **filters: Any) -> Iterator[types.Flight]:
        """Flights, newest first. Unverified."""
        return self._pages("/flights", filters, types.Flight)

    def tracks(self, **filters: Any) -> Iterator[types.Track]:
        """The last broadcast position of each drone. Unverified."""
        return self._pages("/tracks", filters, types.Track)

    def authorisations(self, **filters: Any) -> Iterator[types.Authorisation]:
        """What drones may do at pads."""
        return self._pages("/authorisations", filters, types.Authorisation)

    def alerts(self, **filters: Any) -> Iterator[types.Alert]:
        """Alerts, newest first, page by page as they are read."""
        return self._pages("/alerts", filters, types.Alert)

    def request_proof(self, uav_id: str, pad_id: str, action: str = "land", **more: Any) -> types.ProofRequest:
        """Ask that a drone proves its location at a pad. Sent again after a fault, it is still one request."""
        body = {"uav_id": uav_id, "pad_id": pad_id, "action": action, **more}
        return cast("types.ProofRequest", self._post("/proof-requests", body))

    def proof_request(self, request_id: str) -> types.ProofRequest:
        """What has become of a request."""
        return cast("types.ProofRequest", self._get(f"/proof-requests/{request_id}"))

    def subscribe(self, url: str, **filters: Any) -> types.SubscriptionCreated:
        """Have events sent to `url`. Keep the secret of the answer: `verify_webhook` needs it."""
        return cast("types.SubscriptionCreated", self._post("/subscriptions", {"url": url, **filters}))

    def subscriptions(self) -> Iterator[types.Subscription]:
        """One's own webhooks, page by page as they are read."""
        return self._pages("/subscriptions", {}, types.Subscription)

    def deliveries(self, subscription_id: str, **filters: Any) -> Iterator[types.WebhookDelivery]:
        """What was sent to a webhook, newest first; ``state="dead"``: what was given up."""
        return self._pages(f"/subscriptions/{subscription_id}/deliveries", filters, types.WebhookDelivery)

    def redeliver(self, subscription_id: str, delivery_id: str) -> types.WebhookDelivery:
        """Have a delivery sent once more."""
        path = f"/subscriptions/{subscription_id}/deliveries/{delivery_id}/redeliver"
        return cast("types.WebhookDelivery", self._post(path, None))

    def unsubscribe(self, subscription_id: str) -> None:
        """End a webhook: nothing more is sent to its address."""
        self._transport.request("DELETE", f"/subscriptions/{subscription_id}")

    def export(
        self, into: BinaryIO, kind: Literal["geojson", "csv", "mfjson"], from_ms: int, until_ms: int, **filters: Any
    ) -> types.Export:
        """Write a window of the past into a file (zip with `manifest.json`); returns what it holds.

        `filters`: `drone`, `pad`, `area`. `mfjson` is OGC Moving Features JSON.
        """
        body = {"format": kind, "from_ms": from_ms, "until_ms": until_ms, **filters}
        export_id = self._post("/exports", body)["export_id"]
        self._transport.download(f"/exports/{export_id}/file", into)
        return cast("types.Export", self._get(f"/exports/{export_id}"))

    def events(self, after: str | None = None, **filters: Any) -> Iterator[types.LedgerEvent]:
        """What is committed to the ledger from `after` (an event's id) on, as it happens; without it what is new.

        It never ends by itself: through faults it goes on where it was, and nothing is missed. Keep the id of the
        last event that you have dealt with, and begin with it the next time.
        """
        place = after
        while True:
            headers = {"Accept": "text/event-stream"} | ({"Last-Event-ID": place} if place is not None else {})
            try:
                with self._transport.stream("/events", filters, headers) as lines:
                    for identifier, data in _frames(lines):
                        place = identifier or place
                        if data:
                            yield cast("types.LedgerEvent", json.loads(data))
            except Unreachable:
                time.sleep(PAUSE_S)
            except ApiError as error:
                if error.status != UNAUTHORIZED:
                    raise
                self._transport.forget_token()

    def _get(self, path: str, **params: Any) -> Any:
        return self._transport.request("GET", path, params=params)

    def _post(self, path: str, body: Any) -> Any:
        headers = {"Idempotency-Key": str(uuid.uuid4())}
        return self._transport.request("POST", path, headers=headers, **({} if body is None else {"json": body}))

    def _pages(self, path: str, filters: dict[str, Any], _kind: type[Item]) -> Iterator[Item]:
        cursor: str | None = None
        while True:
            page = self._get(path, **filters, **({"cursor": cursor} if cursor is not None else {}))
            yield from page["items"]
            cursor = page.get("next")
            if cursor is None:
                return


def _frames(lines: Iterable[str]) -> Iterator[tuple[str, str]]:
    """(id, data) of each frame of an event stream."""
    fields: dict[str, str] = {}
    for line in lines:
        if not line:
            if fields:
                yield fields.get("id", ""), fields.get("data", "")
            fields = {}
        elif not line.startswith(":"):
            name, _, value = line.partition(":")
            fields[name] = value.removeprefix(" ")


def _http(certificate: tuple[str, str] | None) -> httpx.Client:
    trusted = httpx.create_ssl_context()
    if certificate is not None:
        trusted.load_cert_chain(*certificate)
    return httpx.Client(timeout=30.0, verify=trusted)
