"""Areas in a DSS: announced while somebody flies, extended, taken back; conflicts, outages, refusals, bad answers."""

from __future__ import annotations

import dataclasses

import httpx
import pytest

from wonderland_backend.http.targets import Destinations
from wonderland_backend.http.transfer import TransferError
from wonderland_backend.settings.uspace import USpaceSettings
from wonderland_backend.uspace.dss.client import DssClient, extents_of
from wonderland_backend.uspace.dss.errors import AreaTooLarge, DssAway, NotThere, TooMany, VersionConflict
from wonderland_backend.uspace.geo import E7, TILES, Box, Cell
from wonderland_backend.uspace.netrid.areas import COMPARE_MS, EXTEND_MS, LIFETIME_MS, LINGER_MS, Areas
from wonderland_backend.uspace.peers import Peers
from wonderland_backend.uspace.token_client import TokenClient

TILE = Cell.at(604_518_000, 222_666_000, TILES)
ID = "00000000-0000-4000-8000-000000000001"
US = "https://us.example"


class Told:
    def __init__(self):
        self.told = []

    def tell_subscriber(self, url, area_id, body):
        self.told.append((url, area_id, body))


class Ours:
    """A DSS client, and what keeps areas by it, as one provider would have them."""

    def __init__(self, authority, http, urls, clock, client_id="us", base_url=US):
        settings = USpaceSettings(
            token_url=f"{authority.url}/token", client_id=client_id, client_secret=authority.secret
        )
        peers = Peers(
            http,
            TokenClient(settings, clock=clock, client=http),
            known=(),
            destinations=Destinations(frozenset({"127.0.0.1"})),
        )
        self.dss = DssClient(urls, clock=clock, peers=peers)
        self.notifier = Told()
        self.problems = []
        self.areas = Areas(self.dss, self.notifier, base_url=base_url, clock=clock, on_problem=self.problems.append)
        self.areas.instance = "an installation"


@pytest.fixture
async def http():
    async with httpx.AsyncClient(trust_env=False) as client:
        yield client


@pytest.fixture
def new_ours(authority, http, dss, clock):
    # The DSS lives in the test's time.
    import time

    dss.now_ms = lambda: clock() + dss.offset_ms
    clock.now_ms = time.time_ns() // 1_000_000
    return lambda *urls, **options: Ours(authority, http, urls or (dss.url,), clock, **options)


def extents(until_ms, cell=TILE):
    return extents_of(cell.box(), until_ms=until_ms, is_cap=cell.is_cap)


async def test_an_area_lives_as_long_as_somebody_flies(new_ours, dss, clock):
    ours = new_ours()
    await ours.areas.step({TILE})
    (area,) = dss.areas.values()
    assert area.owner == "us"
    assert area.box.contains(604_518_000, 222_666_000)
    assert area.end_ms - clock() <= LIFETIME_MS
    assert ours.areas.covers(Box.between(60.45, 22.26, 60.46, 22.27))
    assert not ours.areas.covers(Box.between(10, 22.26, 10.01, 22.27))
    first = area.version
    await ours.areas.step({TILE})
    assert dss.areas[area.entity_id].version == first
    clock.pass_s((LIFETIME_MS - EXTEND_MS) / 1000 + 1)
    await ours.areas.step({TILE})
    (area,) = dss.areas.values()
    assert area.version != first
    await ours.areas.step(())
    assert dss.areas
    clock.pass_s(LINGER_MS / 1000)
    await ours.areas.step(())
    assert dss.areas == {}
    assert not ours.areas.covers(Box.between(60.45, 22.26, 60.46, 22.27))
    assert ours.problems == []


async def test_whoever_starts_again_finds_its_areas(new_ours, dss, clock):
    await new_ours().areas.step({TILE})
    again = new_ours()
    clock.pass_s(10)
    await again.areas.step({TILE})
    assert len(dss.areas) == 1
    assert len(again.areas) == 1
    assert again.problems == []


async def test_another_replica_was_quicker(new_ours, dss, clock):
    one, other = new_ours(), new_ours()
    await one.areas.step({TILE})
    await other.areas.step({TILE})
    clock.pass_s((LIFETIME_MS - EXTEND_MS) / 1000 + 1)
    await one.areas.step({TILE})
    await other.areas.step({TILE})
    assert (one.problems, other.problems, len(dss.areas)) == ([], [], 1)


async def test_an_id_that_is_somebody_elses_is_left_alone(new_ours, dss):
    await new_ours(client_id="them", base_url="https://them.example").areas.step({TILE})
    ours = new_ours()
    await ours.areas.step({TILE})
    assert sorted(each.owner for each in dss.areas.values()) == ["them", "us"]
    assert ours.problems == []


async def test_an_area_that_is_gone_is_announced_anew(new_ours, dss, clock):
    ours = new_ours()
    await ours.areas.step({TILE})
    dss.areas.clear()
    clock.pass_s((LIFETIME_MS - EXTEND_MS) / 1000 + 1)
    await ours.areas.step({TILE})
    assert len(dss.areas) == 1
    dss.areas.clear()
    clock.pass_s(LINGER_MS / 1000)
    await ours.areas.step(())
    assert ours.problems == []
    assert len(ours.areas) == 0


async def test_subscribers_are_told_of_every_change(new_ours, dss, clock):
    them = new_ours(client_id="them", base_url="https://them.example")
    await them.dss.put_subscription(ID, extents(clock() + 3_600_000), "https://them.example", None)
    ours = new_ours()
    await ours.areas.step({TILE})
    clock.pass_s(LINGER_MS / 1000)
    await ours.areas.step(())
    (url, area_id, made), (_, same_id, gone) = ours.notifier.told
    assert (url, area_id) == ("https://them.example", same_id)
    assert made["service_area"]["owner"] == "us"
    assert made["extents"]["volume"]["outline_polygon"]["vertices"]
    assert made["subscriptions"] == [{"subscription_id": ID, "notification_index": 1}]
    assert gone == {"subscriptions": [{"subscription_id": ID, "notification_index": 2}]}


async def test_another_instance_answers_while_one_is_away(new_ours, dss, served, clock):
    async with served(dss.instance()) as second:
        ours = new_ours("http://127.0.0.1:9", second)
        await ours.areas.step({TILE})
        assert len(dss.areas) == 1
        # A version from one instance is good at the other.
        both = new_ours(dss.url, second)
        area = await both.dss.get_area(next(iter(dss.areas)))
        dss.refusals.append((503, None))
        await both.dss.delete_area(area.id, area.version)
        assert dss.areas == {}


async def test_instances_that_differ_are_noticed(new_ours, dss, authority, served, clock):
    apart = type(dss)(authority)
    apart.now_ms = dss.now_ms
    async with served(apart.app) as second:
        ours = new_ours(dss.url, second)
        await ours.areas.step({TILE})
        clock.pass_s(COMPARE_MS / 1000)
        await ours.areas.step({TILE})
        (known,) = dss.areas.values()
        told = f"{dss.url}: {known.version}, {second}: none"
        assert ours.problems == [f"The instances of the DSS differ about an area of ours ({told})"]
        apart.areas[known.entity_id] = dataclasses.replace(known, version="another")
        clock.pass_s(COMPARE_MS / 1000)
        await ours.areas.step({TILE})
        assert f"{second}: another" in ours.problems[1]
        apart.areas = dss.areas
        clock.pass_s(COMPARE_MS / 1000)
        await ours.areas.step({TILE})
        assert len(ours.problems) == 2


async def test_with_no_dss_it_is_tried_again_and_the_operator_learns_of_it(new_ours, dss, clock):
    ours = new_ours("http://127.0.0.1:9")
    await ours.areas.step({TILE})
    await ours.areas.step({TILE})
    assert len(ours.problems) == 1
    assert "not announced just now" in ours.problems[0]
    clock.pass_s(2)
    await ours.areas.step({TILE})
    assert len(ours.problems) == 2
    with pytest.raises(DssAway):
        await ours.dss.get_area(ID)


async def test_what_the_dss_refuses_has_its_name(new_ours, dss, clock):
    ours = new_ours().dss
    until_ms = clock() + 60_000
    with pytest.raises(NotThere):
        await ours.get_area(ID)
    with pytest.raises(NotThere):
        await ours.put_area(ID, extents(until_ms), US, "a version")
    made = await ours.put_area(ID, extents(until_ms), US, None)
    with pytest.raises(VersionConflict):
        await ours.put_area(ID, extents(until_ms), US, None)
    with pytest.raises(VersionConflict):
        await ours.delete_area(ID, "another?version #1")
    large = extents_of(Box.between(60, 22, 61, 23), until_ms=until_ms, is_cap=False)
    with pytest.raises(AreaTooLarge):
        await ours.put_area(ID, large, US, made.service_area.version)
    for number in range(10):
        await ours.put_subscription(f"{ID[:-1]}{number}", extents(until_ms), US, None)
    with pytest.raises(TooMany) as refused:
        await ours.put_subscription(f"{ID[:-1]}a", extents(until_ms), US, None)
    assert refused.value.retry_s == 7


async def test_a_token_that_was_withdrawn_is_replaced_once(new_ours, dss, authority):
    ours = new_ours().dss
    with pytest.raises(NotThere):
        await ours.get_area(ID)
    authority.signs_with, authority.published = "second", ["second"]
    with pytest.raises(NotThere):
        await ours.get_area(ID)
    assert len(authority.tokens_asked) == 2


@pytest.mark.parametrize("offset_s", [-20, 20])
async def test_clocks_that_differ(new_ours, dss, offset_s):
    dss.offset_ms = offset_s * 1000
    ours = new_ours()
    await ours.areas.step({TILE})
    assert ours.problems == []
    assert len(dss.areas) == 1


@pytest.mark.parametrize(
    "answer",
    ['{"service_area": 1}', "[]", "nonsense", '{"service_area": {"id": "x"}}', "[" * 5_000, ""],
)
async def test_answers_that_are_none(new_ours, served, answer):
    from fastapi import FastAPI
    from fastapi.responses import Response

    app = FastAPI()
    app.add_api_route("/{path:path}", lambda: Response(answer), methods=["GET", "PUT"])
    async with served(app) as url:
        ours = new_ours(url)
        with pytest.raises(DssAway):
            await ours.dss.get_area(ID)
        await ours.areas.step({TILE})
        assert len(ours.problems) == 1


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("http://uss.example", "by https"),
        ("https://127.0.0.1:9", "no address of the Internet"),
        ("https://[::1]:9", "no address of the Internet"),
        ("https://localhost:9", "no address of the Internet"),
        ("https://169.254.169.254/latest", "no address of the Internet"),
        ("https://user@uss.example", "no user"),
        ("https://[", "an address that is none"),
    ],
)
async def test_tokens_go_to_the_internet_by_https_only(authority, http, clock, url, words):
    settings = USpaceSettings(token_url=f"{authority.url}/token", client_id="us", client_secret=authority.secret)
    peers = Peers(
        http, TokenClient(settings, clock=clock, client=http), known=["dss.example"], destinations=Destinations()
    )
    with pytest.raises(TransferError, match=words):
        await peers.ask("GET", f"{url}/uss/flights", "rid.display_provider")
    assert authority.tokens_asked == []


def test_an_area_around_a_pole_is_a_circle():
    cap = Cell.at(-90 * E7, 0, TILES)
    outline = extents(0, cap)["volume"]["outline_circle"]
    assert outline["center"]["lat"] == -90
    assert 10_000 <= outline["radius"]["value"] <= 10_100
