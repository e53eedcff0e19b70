"""Conditional requests: lists and single things that the client has already, changes of what has changed since."""

from __future__ import annotations

import asyncio

import pytest

BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
SUBSCRIPTION = {"url": "https://93.184.216.34/in"}


@pytest.mark.parametrize(
    "path",
    ["sessions", "alerts", "authorisations", "verdicts", "proof-requests", "findings", "blocks", "registry/drones"],
)
async def test_a_list_that_the_client_has_is_not_sent_again(running, path):
    first = await running.get(f"/{path}?limit=1")
    assert (first.status_code, first.headers["cache-control"]) == (200, "private, no-cache")
    tag = {"If-None-Match": first.headers["etag"]}
    again = await running.http.get(f"/api/v1/{path}?limit=1", headers=tag)
    assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", first.headers["etag"])
    if "next" in first.json():
        assert f"cursor={first.json()['next']}" in first.headers["link"]
        other = await running.http.get(f"/api/v1/{path}?limit=1&cursor={first.json()['next']}", headers=tag)
        assert other.status_code == 200


async def test_a_list_that_changed_is_sent(running, machine):
    async with machine("wonderland.subscriptions") as http:
        empty = await http.get("/api/v1/subscriptions")
        assert (await http.post("/api/v1/subscriptions", json=SUBSCRIPTION)).status_code == 201
        now = await http.get("/api/v1/subscriptions", headers={"If-None-Match": empty.headers["etag"]})
        assert (now.status_code, len(now.json()["items"])) == (200, 1)


@both
async def test_a_subscription_that_is_no_longer_what_one_saw(running, machine):
    async with machine("wonderland.subscriptions") as http:
        path = (await http.post("/api/v1/subscriptions", json=SUBSCRIPTION)).headers["location"]
        seen = (await http.get(path)).headers["etag"]
        answers = await asyncio.gather(
            *(http.patch(path, json={"state": "paused"}, headers={"If-Match": seen}) for _ in range(2))
        )
        assert sorted(each.status_code for each in answers) == [200, 412]
        refused = next(each for each in answers if each.status_code == 412)
        assert refused.json()["type"] == "urn:wonderland:problem:precondition-failed"
        paused = next(each for each in answers if each.status_code == 200)
        assert paused.headers["etag"] == (await http.get(path)).headers["etag"] != seen
        for stale in (seen, f"W/{paused.headers['etag']}", "nonsense"):
            assert (await http.delete(path, headers={"If-Match": stale})).status_code == 412
        assert (await http.get(path)).json()["state"] == "paused"
        named = f'"other", {paused.headers["etag"]}'
        assert (await http.delete(path, headers={"If-Match": named})).status_code == 204
        assert (await http.delete(path, headers={"If-Match": "*"})).status_code == 404


async def test_a_person_that_is_no_longer_what_one_saw(running):
    token = await running.parts.sign_ins.new_token("Admin", ("admin",))
    await running.http.post("/api/v1/session", json={"token": token})
    made = await running.http.post("/api/v1/people", json={"name": "Aino", "roles": ["inspector"]})
    path = f"/api/v1/people/{made.json()['person']['person_id']}"
    seen = (await running.http.get(path)).headers["etag"]
    change = {"name": "Aino Aalto", "revision": 0}
    done = await running.http.patch(path, json=change, headers={"If-Match": seen})
    assert (done.status_code, done.json()["person"]["name"]) == (200, "Aino Aalto"), done.text
    for method, more in (("PATCH", {"json": {"name": "A", "revision": 1}}), ("DELETE", {})):
        refused = await running.http.request(method, path, headers={"If-Match": seen}, **more)
        assert refused.status_code == 412
    assert (await running.http.get(path)).json() == done.json()
    assert (await running.http.delete(path, headers={"If-Match": done.headers["etag"]})).status_code == 204
