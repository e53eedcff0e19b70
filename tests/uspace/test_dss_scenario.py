"""One scenario with a DSS, from both sides of an area: with the small one of these tests, and with a real one.

The real one is that of WONDERLAND_TEST_DSS (two instances: two addresses with a comma between), its dummy token server
that of WONDERLAND_TEST_DSS_TOKENS.
"""

from __future__ import annotations

import contextlib
import os
import uuid
from urllib.parse import urlsplit

import httpx
import pytest

from wonderland_backend.http.targets import Destinations
from wonderland_backend.http.times import now_ms
from wonderland_backend.settings.uspace import USpaceSettings
from wonderland_backend.uspace.dss.client import DssClient, extents_of
from wonderland_backend.uspace.dss.errors import DssRefused, NotThere, VersionConflict
from wonderland_backend.uspace.geo import TILES, Cell
from wonderland_backend.uspace.peers import Peers
from wonderland_backend.uspace.token_client import TokenClient

REAL = pytest.mark.skipif("WONDERLAND_TEST_DSS" not in os.environ, reason="no real DSS: WONDERLAND_TEST_DSS is not set")
CELL = Cell.at(604_518_000, 222_666_000, TILES)


@pytest.fixture(params=["small", pytest.param("real", marks=REAL)])
async def deployment(request, dss, served):
    """The addresses of the instances, and that of the token server."""
    if request.param == "real":
        yield os.environ["WONDERLAND_TEST_DSS"].split(","), os.environ["WONDERLAND_TEST_DSS_TOKENS"]
        return
    async with served(dss.instance()) as second:
        yield [dss.url, second], f"{dss.authority.url}/token"


@pytest.fixture
async def new_client(deployment):
    """A service provider's client of one instance; each name is another owner."""
    urls, tokens = deployment
    async with httpx.AsyncClient(trust_env=False) as http:

        def make(name, instance=0):
            settings = USpaceSettings(token_url=tokens, client_id=name, token_request="interuss-dummy")
            token_client = TokenClient(settings, clock=now_ms, client=http)
            url = urls[instance % len(urls)]
            peers = Peers(http, token_client, known=(), destinations=Destinations(frozenset({urlsplit(url).hostname})))
            return DssClient([url], clock=now_ms, peers=peers)

        yield make


async def test_areas_subscriptions_versions_and_owners(new_client):
    ours, ours_elsewhere = new_client("wonderland-test"), new_client("wonderland-test", 1)
    theirs = new_client("wonderland-test-other", 1)
    area_id, subscription_id, until_ms = str(uuid.uuid4()), str(uuid.uuid4()), now_ms() + 120_000
    extents = extents_of(CELL.box(), until_ms=until_ms, is_cap=False)

    async def found_by(client):
        areas = await client.search_areas(CELL.box(), from_ms=now_ms(), until_ms=until_ms)
        return {each.id: each for each in areas}.get(area_id)

    subscribed = await theirs.put_subscription(subscription_id, extents, "https://other.example", None)
    versions = []
    try:
        made = await ours.put_area(area_id, extents, "https://wonderland.example", None)
        versions.append(made.service_area.version)
        told = {each.url: [one.subscription_id for one in each.subscriptions] for each in made.subscribers}
        assert subscription_id in told["https://other.example"]
        for client in (ours, ours_elsewhere, theirs):
            assert (await found_by(client)).version == versions[0], "every instance has it"

        with pytest.raises(VersionConflict):
            await ours.put_area(area_id, extents, "https://wonderland.example", None)
        with pytest.raises(DssRefused):
            await theirs.delete_area(area_id, versions[0])
        # Extended at the other instance; what the first one gave is stale now, at both.
        changed = await ours_elsewhere.put_area(area_id, extents, "https://wonderland.example", versions[0])
        versions.append(changed.service_area.version)
        (index,) = (
            one.notification_index
            for each in changed.subscribers
            for one in each.subscriptions
            if one.subscription_id == subscription_id
        )
        assert index > subscribed.subscription.notification_index
        for client in (ours, ours_elsewhere):
            with pytest.raises(VersionConflict):
                await client.put_area(area_id, extents, "https://wonderland.example", versions[0])
            with pytest.raises(VersionConflict):
                await client.delete_area(area_id, versions[0])

        renewed = await theirs.put_subscription(
            subscription_id, extents, "https://other.example", (await theirs.get_subscription(subscription_id)).version
        )
        assert area_id in {each.id for each in renewed.service_areas}
        gone = await ours.delete_area(area_id, versions.pop())
        versions.clear()
        assert "https://other.example" in {each.url for each in gone.subscribers}
        assert await found_by(theirs) is None
        with pytest.raises(NotThere):
            await ours.get_area(area_id)
    finally:
        if versions:
            with contextlib.suppress(DssRefused):
                await ours.delete_area(area_id, versions[-1])
        last = await theirs.get_subscription(subscription_id)
        await theirs.delete_subscription(subscription_id, last.version)
    with pytest.raises(NotThere):
        await theirs.get_subscription(subscription_id)
