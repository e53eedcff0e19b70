"""Webhooks: signed, tried again, given up, sent again; to a real HTTPS receiver, and never to where they must not go."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import hashlib
import hmac
import json

import pytest
import trustme
from jsonschema import Draft202012Validator
from kit.description import document
from kit.webhooks import SCOPES, Receiver, ca, loopback, poster, webhooks
from sqlalchemy import select

from wonderland_backend.db.tables.audit import AuditRow
from wonderland_backend.http.targets import Destinations, TargetRefused, check_url, is_public, resolved
from wonderland_backend.webhooks import post as posting
from wonderland_backend.webhooks.deliver import GIVE_UP_MS, LEASE_MS, Webhooks
from wonderland_backend.webhooks.post import Poster, Undelivered, retry_ms

__all__ = ["ca", "poster", "webhooks"]

START_MS = 1_800_000_000_000
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
DOCUMENT = document()


def conforms(name, value):
    schema = {"$ref": f"#/components/schemas/{name}", "components": DOCUMENT["components"]}
    assert [each.message for each in Draft202012Validator(schema).iter_errors(value)] == []


async def work(webhooks):
    await webhooks.make()
    await webhooks.send_due()


def checked(secret, headers, body):
    """What a receiver does by the specification; returns the content."""
    key = base64.b64decode(secret.removeprefix("whsec_"))
    signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
    expected = base64.b64encode(hmac.new(key, signed, hashlib.sha256).digest()).decode()
    assert headers["webhook-signature"] == f"v1,{expected}"
    return json.loads(body)


@both
async def test_every_event_arrives_once_signed(running, machine, webhooks, ca, chain, facts):
    receiver = Receiver()
    async with receiver.listening(ca) as port, machine(SCOPES) as http:
        body = {"url": f"https://hooks.example:{port}/in?x=1", "types": ["ProofDecided"], "after": "0.0"}
        answer = await http.post("/api/v1/subscriptions", json=body)
        assert answer.status_code == 201, answer.text
        conforms("SubscriptionCreated", answer.json())
        made = answer.json()
        await work(webhooks)
        chain.add(facts.decide("three", pad_id="pad-2", t_ms=START_MS + 20_000, outcome="inconclusive"))
        await running.mirrored(chain.height)
        for _ in range(3):
            await work(webhooks)
        contents = [checked(made["secret"], headers, body) for _, headers, body in receiver.requests]
        assert sorted(each["record"]["outcome"] for each in contents) == ["inconclusive", "refuted", "verified"]
        line, headers, _ = receiver.requests[0]
        assert line == "POST /in?x=1 HTTP/1.1"
        assert headers["host"] == f"hooks.example:{port}"
        assert len({headers["webhook-id"] for _, headers, _ in receiver.requests}) == 3
        told = document()["webhooks"]["event"]["post"]
        assert {each["name"] for each in told["parameters"]} < set(headers)
        for each in contents:
            conforms("LedgerEvent", each)
        path = answer.headers["location"]
        deliveries = (await http.get(f"{path}/deliveries")).json()
        conforms("WebhookDeliveryPage", deliveries)
        assert [each["state"] for each in deliveries["items"]] == ["delivered"] * 3
        seen = (await http.get(path)).json()
        conforms("Subscription", seen)
        assert made["secret"] not in json.dumps(seen)


@both
async def test_what_fails_is_tried_again_then_given_up_and_sent_again_by_hand(running, machine, webhooks, ca, clock):
    receiver = Receiver()
    receiver.answers = [500, 302]
    async with receiver.listening(ca) as port, machine(SCOPES) as http:
        body = {"url": f"https://hooks.example:{port}/", "outcomes": ["refuted"], "after": "0.0"}
        path = (await http.post("/api/v1/subscriptions", json=body)).headers["location"]

        async def delivery(**query):
            await http.renew()
            (found,) = (await http.get(f"{path}/deliveries", params=query)).json()["items"]
            return found

        for attempts, status in ((1, 500), (2, 302)):
            await work(webhooks)
            found = await delivery(state="waiting")
            assert (found["attempts"], found["status"], found["problem"]) == (attempts, status, f"it answered {status}")
            assert found["next_ms"] == clock.now_ms + retry_ms(attempts)
            await work(webhooks)
            assert len(receiver.requests) == attempts, "not before its time"
            clock.now_ms += retry_ms(attempts)
        receiver.answers = [500] * 50
        clock.now_ms += GIVE_UP_MS
        await work(webhooks)
        dead = await delivery(state="dead")
        assert "next_ms" not in dead
        clock.now_ms += GIVE_UP_MS
        await work(webhooks)
        assert len(receiver.requests) == 3
        receiver.answers = []
        await http.renew()
        again = await http.post(f"{path}/deliveries/{dead['delivery_id']}/redeliver")
        assert (again.status_code, again.json()["state"]) == (202, "waiting")
        await work(webhooks)
        assert (await delivery())["state"] == "delivered"
        assert {headers["webhook-id"] for _, headers, _ in receiver.requests} == {dead["delivery_id"]}


async def test_it_can_be_tried_and_says_what_came_back(running, machine, webhooks, ca):
    receiver = Receiver()
    receiver.answers = [204, 302, 500]
    async with receiver.listening(ca) as port, machine(SCOPES, name="Bot") as http, machine(SCOPES) as other:
        body = {"url": f"https://hooks.example:{port}/in", "types": ["ProofDecided"]}
        answer = await http.post("/api/v1/subscriptions", json=body)
        path, made = answer.headers["location"], answer.json()
        await http.patch(path, json={"state": "paused"})
        for status in (204, 302, 500):
            told = await http.post(f"{path}/test")
            assert told.status_code == 200, told.text
            conforms("WebhookTest", told.json())
            assert (told.json()["arrived"], told.json()["status"]) == (status == 204, status)
            _, headers, sent = receiver.requests[-1]
            event = checked(made["secret"], headers, sent)
            conforms("WebhookTestEvent", event)
            assert (event["type"], event["id"]) == ("webhook.test", headers["webhook-id"])
            assert (told.json()["body"].encode(), told.json()["headers"]) == (
                sent, {name: headers[name] for name in ("webhook-id", "webhook-timestamp", "webhook-signature")},
            )  # fmt: skip
        assert len({headers["webhook-id"] for _, headers, _ in receiver.requests}) == 3
        assert (await http.get(f"{path}/deliveries")).json()["items"] == [], "nothing of it is tried again"
        assert (await other.post(f"{path}/test")).status_code == 404
    async with machine(SCOPES) as http:
        path = (await http.post("/api/v1/subscriptions", json=body)).headers["location"]
        gone = (await http.post(f"{path}/test")).json()
        conforms("WebhookTest", gone)
        assert (gone["arrived"], "status" in gone, gone["problem"][:12]) == (False, False, "ConnectError")
    async with running.context.database.read() as database:
        rows = (await database.scalars(select(AuditRow).where(AuditRow.act == "test_subscription"))).all()
    assert [json.loads(each.detail) for each in rows] == [
        {"arrived": True, "status": 204}, {"arrived": False, "status": 302}, {"arrived": False, "status": 500},
        {"arrived": False},
    ]  # fmt: skip


async def test_it_is_tried_six_times_a_minute_at_most(machine, webhooks, ca, clock):
    receiver = Receiver()
    async with receiver.listening(ca) as port, machine(SCOPES) as http:
        body = {"url": f"https://hooks.example:{port}/in"}
        paths = [(await http.post("/api/v1/subscriptions", json=body)).headers["location"] for _ in range(2)]
        answers = [await http.post(f"{paths[each % 2]}/test") for each in range(7)]
        assert [each.status_code for each in answers] == [200] * 6 + [429]
        assert answers[-1].json()["type"] == "urn:wonderland:problem:too-many-requests"
        assert answers[-1].headers["retry-after"] == "60"
        assert len(receiver.requests) == 6
        clock.now_ms += 60_000
        assert (await http.post(f"{paths[0]}/test")).status_code == 200


async def test_only_what_is_there_is_sent_again(running, machine, webhooks):
    async with machine(SCOPES) as http:
        path = (await http.post("/api/v1/subscriptions", json={"url": "https://hooks.example/"})).headers["location"]
        assert (await http.post(f"{path}/deliveries/{'0' * 32}/redeliver")).status_code == 404


async def test_a_replica_leaves_alone_what_another_has_begun(running, machine, webhooks, poster, ca, clock):
    receiver = Receiver()
    receiver.answers = ["hang"]
    async with receiver.listening(ca) as port, machine(SCOPES) as http:
        body = {"url": f"https://hooks.example:{port}/", "outcomes": ["refuted"], "after": "0.0"}
        await http.post("/api/v1/subscriptions", json=body)
        busy = asyncio.create_task(work(webhooks))
        await asyncio.wait_for(receiver.arrived.wait(), 5)
        other = Webhooks(running.context.database, poster, running.parts.sealing, running.parts.commits, clock)
        await work(other)
        assert len(receiver.requests) == 1
        clock.now_ms += LEASE_MS
        await work(other)
        assert len(receiver.requests) == 2, "the other one died: its lease is over"
        busy.cancel()
        await asyncio.gather(busy, return_exceptions=True)


@pytest.mark.parametrize("how", ["hang", "drip"])
async def test_a_receiver_that_hangs_is_left(poster, ca, monkeypatch, how):
    monkeypatch.setattr(posting, "TOTAL_S", 1)
    receiver = Receiver()
    receiver.answers = [how]
    async with receiver.listening(ca) as port:
        with pytest.raises(Undelivered, match="in time"):
            await poster.post(f"https://hooks.example:{port}/", "s", "id", 1, b"{}")
    assert len(receiver.requests) == 1


async def test_a_receiver_that_never_says_a_word(ca, monkeypatch):
    monkeypatch.setattr(posting, "TIMEOUT_S", 0.5)
    poster = Poster(Destinations(frozenset({"hooks.example"})), ca_file=ca.path, lookup=loopback)

    gone = asyncio.Event()

    async def silent(reader, writer):
        with contextlib.suppress(ConnectionError):
            await reader.read()
        writer.close()
        gone.set()

    server = await asyncio.start_server(silent, "127.0.0.1", 0)
    async with server:
        port = server.sockets[0].getsockname()[1]
        with pytest.raises(Undelivered, match="Timeout"):
            await poster.post(f"https://hooks.example:{port}/", "s", "id", 1, b"{}")
        await asyncio.wait_for(gone.wait(), 10)
    await poster.close()


@pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
async def test_a_redirect_is_not_followed(poster, ca, status):
    first, second = Receiver(), Receiver()
    async with first.listening(ca) as port, second.listening(ca) as other:
        first.answers, first.location = [status], f"https://hooks.example:{other}/"
        with pytest.raises(Undelivered, match=f"answered {status}"):
            await poster.post(f"https://hooks.example:{port}/", "s", "id", 1, b"{}")
    assert (len(first.requests), second.requests) == (1, [])


async def test_a_receiver_that_is_somebody_else(poster, ca, monkeypatch):
    receiver = Receiver()
    monkeypatch.setattr(posting, "TOTAL_S", 5)
    async with receiver.listening(ca, "other.example") as port:
        with pytest.raises(Undelivered, match="certificate"):
            await poster.post(f"https://hooks.example:{port}/", "s", "id", 1, b"{}")
    async with receiver.listening(trustme.CA()) as port:
        with pytest.raises(Undelivered, match="certificate"):
            await poster.post(f"https://hooks.example:{port}/", "s", "id", 1, b"{}")
    with pytest.raises(Undelivered, match="ConnectError"):
        await poster.post("https://hooks.example:1/", "s", "id", 1, b"{}")
    assert receiver.requests == []


async def test_a_paused_webhook_loses_nothing_and_a_removed_one_is_gone(running, machine, webhooks, ca):
    receiver = Receiver()
    async with receiver.listening(ca) as port, machine(SCOPES) as http:
        body = {"url": f"https://hooks.example:{port}/", "types": ["ProofDecided"], "after": "0.0"}
        path = (await http.post("/api/v1/subscriptions", json=body)).headers["location"]
        assert (await http.patch(path, json={"state": "paused"})).json()["state"] == "paused"
        await work(webhooks)
        assert receiver.requests == []
        await http.patch(path, json={"state": "active"})
        await work(webhooks)
        assert len(receiver.requests) == 2
        assert (await http.delete(path)).status_code == 204
        assert (await http.get(path)).status_code == 404


async def test_a_revoked_client_is_told_nothing_more(running, machine, webhooks, ca):
    receiver = Receiver()
    async with receiver.listening(ca) as port, machine(SCOPES) as http:
        body = {"url": f"https://hooks.example:{port}/", "after": "0.0"}
        assert (await http.post("/api/v1/subscriptions", json=body)).status_code == 201
        async with running.context.database.write() as connection:
            await running.parts.clients.revoke(connection, http.client_id, "a test")
        await work(webhooks)
        assert receiver.requests == []


async def test_each_sees_its_own_and_an_administrator_all(running, machine, webhooks):
    async with machine(SCOPES) as one, machine(SCOPES, name="Other") as other:
        body = {"url": "https://hooks.example/", "name": "mine"}
        path = (await one.post("/api/v1/subscriptions", json=body)).headers["location"]
        assert (await other.get(path)).status_code == 404
        assert (await other.delete(path)).status_code == 404
        assert (await other.get("/api/v1/subscriptions")).json()["items"] == []
        token = await running.parts.sign_ins.new_token("Admin", ("admin",))
        await running.http.post("/api/v1/session", json={"token": token})
        assert [each["name"] for each in (await running.json("/subscriptions"))["items"]] == ["mine"]
    token = await running.parts.sign_ins.new_token("Looker", ("viewer",))
    await running.http.post("/api/v1/session", json={"token": token})
    assert (await running.http.post("/api/v1/subscriptions", json=body)).status_code == 403


@both
async def test_an_idempotency_key_makes_one_of_two(running, machine, webhooks):
    async with machine(SCOPES) as http:
        body = {"url": "https://hooks.example/"}
        key = {"Idempotency-Key": "k1"}
        first, second = await asyncio.gather(
            *(http.post("/api/v1/subscriptions", json=body, headers=key) for _ in range(2))
        )
        assert {first.status_code, second.status_code} <= {201, 409}
        again = await http.post("/api/v1/subscriptions", json=body, headers=key)
        assert again.status_code == 201
        assert again.headers["idempotency-replayed"] == "true"
        made = next(each for each in (first, second) if each.status_code == 201)
        assert (again.json(), again.headers["location"]) == (made.json(), made.headers["location"])
        assert len((await http.get("/api/v1/subscriptions")).json()["items"]) == 1
        other = await http.post("/api/v1/subscriptions", json=body | {"name": "x"}, headers=key)
        assert (other.status_code, other.json()["type"]) == (422, "urn:wonderland:problem:invalid-request")
        failed = await http.post("/api/v1/subscriptions", json={"url": "http://x/"}, headers={"Idempotency-Key": "k2"})
        assert failed.status_code == 422
        assert (
            await http.post("/api/v1/subscriptions", json=body, headers={"Idempotency-Key": "k2"})
        ).status_code == 201
        long = {"Idempotency-Key": "k" * 129}
        assert (await http.post("/api/v1/subscriptions", json=body, headers=long)).status_code == 400


@pytest.mark.parametrize(
    "url",
    [
        "http://example.com/", "ftp://example.com/", "https://", "https://user:pw@example.com/", "https://example.com/#x",
        "https://127.0.0.1/", "https://[::1]/", "https://10.0.0.1/", "https://192.168.1.1/", "https://169.254.169.254/",
        "https://0.0.0.0/", "https://[::ffff:127.0.0.1]/", "https://[64:ff9b::7f00:1]/", "https://[fd00::1]/",
        "https://224.0.0.1/", "https://100.64.0.1/", "https://[2002:7f00:1::]/", "https://example.com:99999/", "nonsense",
        "https://exa mple.com/", "https://ex\u00e4mple.com/", "https://example.com:0/",
    ],
)  # fmt: skip
async def test_targets_that_are_refused(running, machine, url):
    with pytest.raises(TargetRefused):
        check_url(url, Destinations())
    async with machine(SCOPES) as http:
        answer = await http.post("/api/v1/subscriptions", json={"url": url})
        assert (answer.status_code, answer.json()["errors"][0]["path"]) == (422, "body.url")


@pytest.mark.parametrize(
    ("host", "goes"),
    [
        ("hooks.example", True), ("a.partner.example", True), ("inside.local", True),
        ("partner.example", False), ("evilpartner.example", False), ("hooks.example.evil.example", False),
        ("93.184.216.34", False),
    ],
)  # fmt: skip
async def test_only_hosts_that_are_listed_where_there_is_a_list(host, goes):
    listed = Destinations(frozenset({"inside.local"}), ("hooks.example", ".partner.example"))

    async def lookup(host, port):
        return ["93.184.216.34"]

    for url in (f"https://{host}/", f"https://{host.upper()}./", f"https://{host}:8443/x"):
        if goes:
            assert (await resolved(url, listed, lookup)).host == host
        else:
            with pytest.raises(TargetRefused, match="outbound_hosts"):
                await resolved(url, listed, lookup)


@pytest.mark.parametrize("addresses", [["127.0.0.1"], ["93.184.216.34", "10.0.0.1"], ["::1"], []])
async def test_a_name_is_judged_by_all_of_its_addresses(addresses):
    async def lookup(host, port):
        return addresses

    with pytest.raises(TargetRefused):
        await resolved("https://rebinding.example/", Destinations(), lookup)
    if addresses:
        assert (
            await resolved("https://rebinding.example/", Destinations(frozenset({"rebinding.example"})), lookup)
        ).host


async def test_the_address_that_was_checked_is_the_one_that_is_called(ca):
    answers = [["127.0.0.1"], ["192.0.2.1"]]

    async def lookup(host, port):
        return answers.pop(0)

    receiver = Receiver()
    poster = Poster(Destinations(frozenset({"hooks.example"})), ca_file=ca.path, lookup=lookup)
    async with receiver.listening(ca) as port:
        assert await poster.post(f"https://hooks.example:{port}/", "s", "id", 1, b"{}") == 204
    assert len(receiver.requests) == 1
    assert len(answers) == 1
    await poster.close()


async def test_a_name_that_cannot_be_resolved():
    async def lookup(host, port):
        raise OSError("no such host")

    with pytest.raises(TargetRefused, match="no such host"):
        await resolved("https://nowhere.example/", Destinations(), lookup)


def test_addresses_of_the_internet():
    import ipaddress

    assert is_public(ipaddress.ip_address("93.184.216.34"))
    assert is_public(ipaddress.ip_address("2606:2800:220:1::1"))
    assert is_public(ipaddress.ip_address("64:ff9b::5db8:d822"))
