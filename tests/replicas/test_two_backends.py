"""Two backends on one database: one on duty, the other shows the same; either dies or hangs, and consoles go on."""

from __future__ import annotations

import asyncio
import time

import pytest
from kit.replicas import Console, client, cookie, eventually, same_board

BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
pytestmark = [pytest.mark.timeout(300), pytest.mark.parametrize("database_url", BOTH, indirect=True)]


async def begun(replicas):
    """The one on duty, the follower, and the cookie of somebody who is signed in."""
    first = await replicas.begin("backend-1")
    told = await first.told()
    assert told["ready"] is True
    second = await replicas.begin("backend-2")
    assert (await second.told()) == {"follows": True, "url": second.url}
    return first, second, await cookie(first.url, told["token"])


async def agree(one, other, least=20):
    """Both were told the same bytes under the same numbers."""
    await eventually(lambda: len(one.digests.keys() & other.digests.keys()) >= least, what="frames that both have")
    common = one.digests.keys() & other.digests.keys()
    assert {place: one.digests[place] for place in common} == {place: other.digests[place] for place in common}


def whole(*consoles):
    for each in consoles:
        assert (each.holes, each.told_twice) == ([], [])


async def have_all(field, *consoles):
    await eventually(
        lambda: all(set(field.proved) <= each.verdicts.keys() for each in consoles), 30, "every verdict everywhere"
    )


class Consoles:
    """Closed at the end."""

    def __init__(self, *consoles):
        self.consoles = consoles

    async def __aenter__(self):
        return self.consoles

    async def __aexit__(self, *_):
        await asyncio.gather(*(each.close() for each in self.consoles))


async def test_the_follower_shows_what_the_other_one_shows_and_takes_over(replicas, field):
    first, second, signed_in = await begun(replicas)
    here, there = Console(first.url, second.url, cookie=signed_in), Console(second.url, cookie=signed_in)
    async with Consoles(here, there):
        async with field.reporting(first.url):
            await eventually(lambda: there.picture["tracks"], what="positions at the follower")
            for _ in range(3):
                await field.prove()
            await have_all(field, here, there)
            await eventually(lambda: there.picture["pads"]["pad-0"].get("health"))
            shown = await same_board(first.url, second.url, signed_in)
            assert len(shown["tracks"]) == 6
            assert len(shown["verdicts"]) == 3
            assert not there.is_stale
            await agree(here, there)
            async with client(second.url, signed_in) as http:
                pad = (await http.get("/api/v1/pads/pad-0")).json()
                assert pad["health"]["connected"] is True
                verdicts = (await http.get("/api/v1/verdicts")).json()["items"]
                assert {each["session_id"] for each in verdicts} == set(field.proved)

        first.process.kill()
        killed = time.monotonic()
        connections = there.connections
        for _ in range(2):
            await field.prove()
        told = await second.told()
        assert told["ready"] is True
        async with field.reporting(second.url):
            await have_all(field, here, there)
            await eventually(lambda: here.place and here.place == there.place, what="both at one number")
            assert time.monotonic() - killed < 15
            assert there.connections == connections, "the follower's consoles stay connected"
            assert not there.is_stale
            await eventually(lambda: len(there.picture["tracks"]) == 6)
        whole(here, there)


async def test_a_follower_that_is_killed_leaves_its_consoles_to_the_other(replicas, field):
    first, second, signed_in = await begun(replicas)
    console = Console(second.url, first.url, cookie=signed_in)
    async with Consoles(console), field.reporting(first.url):
        await field.prove()
        await have_all(field, console)
        await eventually(lambda: len(console.digests) > 20)
        assert console.beginnings == 1
        await second.kill()
        await field.prove()
        await have_all(field, console)
        seen = len(console.digests)
        await eventually(lambda: len(console.digests) > seen + 20)
        assert console.beginnings == 1, "it resumes at the other backend by its number"
        whole(console)


async def test_the_router_dies_and_comes_back(replicas, field):
    first, second, signed_in = await begun(replicas)
    here, there = Console(first.url, cookie=signed_in), Console(second.url, cookie=signed_in)
    async with Consoles(here, there), field.reporting(first.url):
        await field.prove()
        await have_all(field, here, there)
        await replicas.bus.kill()
        await field.prove()
        await eventually(lambda: there.is_stale, 15, "the follower says that its picture is old")
        assert there.connections == 1
        async with client(second.url, signed_in) as http:
            # What is in the database is read as ever; what changes something is said not to be possible.
            assert len((await http.get("/api/v1/verdicts")).json()["items"]) == 2
            refused = await http.delete("/api/v1/session")
            assert (refused.status_code, refused.json()["type"]) == (503, "urn:wonderland:problem:standby")
            assert (await http.get("/api/v1/status")).json()["server"]["stale_since_ms"] is not None
            assert "wonderland_backend_on_duty 0.0" in (await http.get("/api/v1/metrics")).text
        late = await field.prove()
        await replicas.bus.start()
        await have_all(field, there)
        await eventually(lambda: not there.is_stale, 20, "fresh again")
        assert late[1]["session_id"] in there.verdicts
        await same_board(first.url, second.url, signed_in)
        await agree(here, there, 60)
        assert (there.connections, there.beginnings) == (1, 1), "the gap was filled by the frames that were missed"
        whole(here, there)


async def test_whoever_hangs_is_told_of_and_caught_up_with(replicas, field):
    first, second, signed_in = await begun(replicas)
    here, there = Console(first.url, cookie=signed_in), Console(second.url, cookie=signed_in)
    async with Consoles(here, there), field.reporting(first.url):
        await field.prove()
        await have_all(field, here, there)

        first.stop()
        await eventually(lambda: there.is_stale, 15, "the follower says that its picture is old")
        async with client(second.url, signed_in) as http:
            refused = await http.delete("/api/v1/session")
            assert refused.status_code == 503
        first.go_on()
        await eventually(lambda: not there.is_stale, 20, "fresh again")
        await field.prove()
        await have_all(field, here, there)

        second.stop()
        await asyncio.sleep(8)  # longer than the bus waits for it
        await field.prove()
        second.go_on()
        await have_all(field, here, there)
        await eventually(lambda: not there.is_stale, 20, "fresh again")
        await same_board(first.url, second.url, signed_in)
        await agree(here, there)
        whole(here, there)


async def test_what_changes_something_is_done_once_by_the_one_on_duty_and_audited(replicas, field):
    first, second, signed_in = await begun(replicas)
    there = Console(second.url, cookie=signed_in)
    async with Consoles(there), field.reporting(first.url), client(second.url, signed_in) as http:
        await field.prove()
        await have_all(field, there)
        alert = await eventually(lambda: next(iter(there.picture["alerts"].values()), None), what="an alert")
        path = f"/api/v1/alerts/{alert['alert_id']}/acts"
        act = {"act": "acknowledge", "revision": alert["revision"], "note": "called the pilot"}
        # This machine is a trusted proxy: the address is the caller's.
        done = await http.post(path, json=act, headers={"X-Forwarded-For": "203.0.113.7"})
        assert done.status_code == 200, done.text
        again = await http.post(path, json=act)
        assert again.status_code == 409
        await eventually(lambda: alert["alert_id"] not in there.picture["alerts"])

        foreign = await http.post(path, json=act, headers={"Origin": "https://evil.example"})
        assert (foreign.status_code, foreign.json()["type"]) == (403, "urn:wonderland:problem:foreign-origin")
        stranger = await http.post(
            "/api/v1/session", json={"token": "x" * 43}, headers={"X-Forwarded-For": "203.0.113.9", "Cookie": ""}
        )
        assert stranger.status_code == 401
        large = await http.post(path, content=b" " * 70_000)
        assert large.status_code == 413

        async with client(first.url, signed_in) as other:
            rows = (await other.get("/api/v1/audit", params={"limit": 200})).json()["items"]
        failed = [each for each in rows if each["act"] == "sign_in_failed"]
        assert [each["detail"]["address"] for each in failed] == ["203.0.113.9"]
        refused = [each for each in rows if each["act"] == "refused"]
        assert len({(each["subject"], each["detail"]["status"]) for each in refused}) == len(refused), refused

        # Who signs out at the one ends at the other, too.
        assert (await http.delete("/api/v1/session")).status_code in {200, 204}
        assert (await http.get("/api/v1/verdicts")).status_code == 401
        await eventually(lambda: there.refused == 4401, 5, "the live connection ends with the sign-in")
