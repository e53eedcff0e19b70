"""What can go wrong between a program and the server."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class ClientError(Exception):
    """Base of what this package raises."""


class ApiError(ClientError):
    """The server refused (RFC 9457). ``code`` is the last part of the problem's type, for programs."""

    def __init__(self, status: int, problem: Mapping[str, Any]) -> None:
        super().__init__(f"{status} {problem.get('title', '')}: {problem.get('detail', '')}")
        self.status = status
        self.code = str(problem.get("type", "")).rpartition(":")[2]
        self.problem = dict(problem)


class TokenError(ClientError):
    """The server gives this client no token. ``code`` as in RFC 6749, 5.2."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(f"{code}: {text}")
        self.code = code


class Unreachable(ClientError):  # noqa: N818 - says what is the case
    """No answer, or none that this package understands."""


class WebhookError(ClientError):
    """A request that claims to be a webhook is none: its signature or its time is wrong."""
