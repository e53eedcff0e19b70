"""What every part of a running backend stands on, and how an endpoint gets the parts that it needs.

An endpoint names what it needs in its signature: ``context: ContextDep, hub: HubDep``. Each part declares its own
``…Dep`` beside its class, so that nothing here knows the parts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, cast

from fastapi import Depends
from starlette.requests import HTTPConnection

from wonderland_backend.db.engine import Database
from wonderland_backend.errors import Elsewhere
from wonderland_backend.settings import Settings

if TYPE_CHECKING:
    import httpx

T = TypeVar("T")


@dataclass
class Context:
    """One running backend: its settings, database, clock, randomness and name."""

    settings: Settings
    database: Database
    clock: Callable[[], int]
    """Milliseconds since the Unix epoch."""
    randomness: Callable[[int], bytes]
    http: httpx.AsyncClient
    """For asking other systems; bounded, without redirects."""
    epoch: str
    version: str
    instance: str = ""
    """Of the database, from the start on."""

    @property
    def cookie_name(self) -> str:
        """Cookies do not tell ports apart, so that two backends on one host need two names."""
        name = f"wonderland_{self.instance[:8]}"
        return f"__Host-{name}" if self.settings.is_https else name


def part_of(connection: HTTPConnection, kind: type[T]) -> T | None:
    """The one part of that type of the backend that serves this request; None where it has none.

    Raises `Elsewhere` for a part that only the backend on duty has, where this one is not.
    """
    parts: Mapping[type, object] = connection.app.state.parts
    found = parts.get(kind)
    if found is Elsewhere:
        raise Elsewhere
    return cast("T | None", found)


def required(connection: HTTPConnection, kind: type[T]) -> T:
    """The same for a part that every backend has, where no signature can name it."""
    found = part_of(connection, kind)
    assert found is not None, kind
    return found


def part(kind: type[T]) -> Any:
    """A dependency for a part that every backend has, as ``HubDep`` is made."""

    async def find(connection: HTTPConnection) -> T:
        return required(connection, kind)

    return Depends(find)


def maybe(kind: type[T]) -> Any:
    """A dependency for a part that some backends have, as ``DemoRegistrarDep`` is made."""

    async def find(connection: HTTPConnection) -> T | None:
        return part_of(connection, kind)

    return Depends(find)


ContextDep = Annotated[Context, part(Context)]
