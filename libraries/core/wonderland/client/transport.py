"""Requests with a token that is fetched when it is needed, tried again where the server asks for it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, BinaryIO, Final

import httpx

from wonderland.client.errors import ApiError, TokenError, Unreachable

RENEW_S: Final = 60
"""A token is renewed so long before its end."""
ATTEMPTS: Final = 4
LONGEST_WAIT_S: Final = 60.0
WAIT: Final = frozenset({429, 503})
PREFIX: Final = "/api/v1"


class Transport:
    """One server, one client's credentials. `sleep` and `clock` are for tests."""

    def __init__(
        self,
        http: httpx.Client,
        client_id: str,
        client_secret: str | None,
        *,
        scope: str | None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._http = http
        self._by_certificate = {"client_id": client_id} if client_secret is None else {}
        self._auth = httpx.Auth() if client_secret is None else httpx.BasicAuth(client_id, client_secret)
        self._scope = scope
        self._clock = clock
        self._sleep = sleep
        self._token = ""
        self._good_until_s = 0.0

    def request(self, method: str, path: str, **options: Any) -> Any:
        """The JSON of an answer, or the text of a signed one; None where it has no body.

        Raises `ApiError`, `TokenError`, `Unreachable`.
        """
        for attempt in range(1, ATTEMPTS + 1):
            answer = self._send(method, path, options, renew=attempt > 1)
            if answer.is_success:
                if answer.headers.get("content-type", "").startswith("application/jose"):
                    return answer.text
                return answer.json() if answer.content else None
            if attempt == ATTEMPTS or not self._may_try_again(method, answer, options):
                raise _refused(answer)
            if answer.status_code in WAIT:
                self._sleep(_wait_s(answer))
        raise AssertionError

    @contextmanager
    def stream(self, path: str, params: Mapping[str, Any], headers: Mapping[str, str]) -> Iterator[Iterator[str]]:
        """The lines of an endless answer. Raises as `request`."""
        timeout = httpx.Timeout(10.0, read=60.0)
        try:
            with self._http.stream(
                "GET", PREFIX + path, params=params, headers={**headers, **self._bearer()}, timeout=timeout
            ) as answer:
                if not answer.is_success:
                    answer.read()
                    raise _refused(answer)
                yield answer.iter_lines()
        except httpx.HTTPError as error:
            raise Unreachable(f"{type(error).__name__}: {error}") from error

    def download(self, path: str, into: BinaryIO) -> None:
        """Write the bytes of an answer as they come. Raises as `request`."""
        for attempt in range(1, ATTEMPTS + 1):
            try:
                with self._http.stream("GET", PREFIX + path, headers=self._bearer()) as answer:
                    if answer.is_success:
                        into.writelines(answer.iter_bytes())
                        return
                    answer.read()
            except httpx.HTTPError as error:
                raise Unreachable(f"{type(error).__name__}: {error}") from error
            if attempt == ATTEMPTS or not self._may_try_again("GET", answer, {}):
                raise _refused(answer)
            self.forget_token()
            if answer.status_code in WAIT:
                self._sleep(_wait_s(answer))

    def forget_token(self) -> None:
        """The next request fetches a new one."""
        self._token = ""

    def _send(self, method: str, path: str, options: Mapping[str, Any], *, renew: bool) -> httpx.Response:
        if renew:
            self.forget_token()
        headers = {**options.get("headers", {}), **self._bearer()}
        try:
            return self._http.request(method, PREFIX + path, **{**options, "headers": headers})
        except httpx.HTTPError as error:
            raise Unreachable(f"{type(error).__name__}: {error}") from error

    def _may_try_again(self, method: str, answer: httpx.Response, options: Mapping[str, Any]) -> bool:
        if answer.status_code == 401:
            return True
        repeatable = method in {"GET", "DELETE"} or "Idempotency-Key" in options.get("headers", {})
        return answer.status_code in WAIT and repeatable

    def _bearer(self) -> dict[str, str]:
        if not self._token or self._clock() > self._good_until_s:
            self._fetch_token()
        return {"Authorization": f"Bearer {self._token}"}

    def _fetch_token(self) -> None:
        form = {"grant_type": "client_credentials"} | ({"scope": self._scope} if self._scope else {})
        form |= self._by_certificate
        try:
            answer = self._http.post("/oauth/token", data=form, auth=self._auth)
            content = answer.json()
        except (httpx.HTTPError, ValueError) as error:
            raise Unreachable(f"no token: {type(error).__name__}: {error}") from error
        if not answer.is_success:
            code, text = content.get("error"), content.get("error_description")
            raise TokenError(str(code or answer.status_code), str(text or content.get("detail", "")))
        self._token = content["access_token"]
        self._good_until_s = self._clock() + content["expires_in"] - RENEW_S


def _refused(answer: httpx.Response) -> ApiError:
    try:
        problem = answer.json()
    except ValueError:
        problem = {"title": answer.reason_phrase, "detail": answer.text[:200]}
    return ApiError(answer.status_code, problem if isinstance(problem, dict) else {})


def _wait_s(answer: httpx.Response) -> float:
    told = answer.headers.get("retry-after", "")
    return min(LONGEST_WAIT_S, float(told)) if told.isdecimal() else 1.0
