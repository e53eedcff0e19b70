"""Machines that speak to it with tokens."""

from __future__ import annotations

import contextlib
import functools

import httpx
import pytest
from kit import PLAIN

from wonderland_backend.clients.store import NewClient


async def register(running, scopes, **options):
    """A client and its secret."""
    wanted = NewClient(options.pop("name", "Tester"), tuple(scopes.split()), **options)
    async with running.context.database.write() as connection:
        return await running.parts.clients.add(connection, wanted, "a test")


@pytest.fixture(name="register")
def _register():
    return register


@contextlib.asynccontextmanager
async def machine_at(running, scopes, **options):
    """An HTTP client of this backend with a token of these scopes; further options are those of a new client."""
    row, secret = await register(running, scopes, **options)
    async with httpx.AsyncClient(base_url=running.url, trust_env=False, verify=PLAIN, timeout=30) as http:

        async def renew():
            form = {"grant_type": "client_credentials"}
            answer = await http.post("/oauth/token", data=form, auth=(row.client_id, secret))
            assert answer.status_code == 200, answer.text
            http.headers["Authorization"] = f"Bearer {answer.json()['access_token']}"

        http.client_id, http.renew = row.client_id, renew
        await renew()
        yield http


@pytest.fixture(name="machine_at")
def _machine_at():
    """For tests with a backend of their own: two that run on one database are two mirrors, and one halts."""
    return machine_at


@pytest.fixture
def machine(running):
    """The same at the running backend."""
    return functools.partial(machine_at, running)
