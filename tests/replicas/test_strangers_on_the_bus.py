"""Who has no backend's certificate hears nothing; who has one of another authority understands nothing and is not heard."""

from __future__ import annotations

import asyncio
import os

import pytest
import zenoh
from kit.replicas import Console, client, cookie, eventually

from wonderland_backend.audit import queries
from wonderland_backend.db.engine import Database
from wonderland_backend.http.times import now_ms
from wonderland_backend.live.aside import Aside
from wonderland_backend.live.hub import Frame
from wonderland_backend.replicas import keys
from wonderland_backend.replicas.messages import Request, Told, Wanted, encode
from wonderland_backend.replicas.pieces import cut
from wonderland_backend.replicas.sealed import Seal
from wonderland_bus.session import open_member

pytestmark = [
    pytest.mark.timeout(240),
    pytest.mark.parametrize("database_url", ["sqlite"], indirect=True),
]
FORGED = '{"type":"delta","seq":%d,"t_ms":%d,"tracks":[{"uav_id":"FORGED","lat_e7":1,"lon_e7":1,"t_ms":%d}]}'


class Stranger:
    """A session of somebody's, and what it hears."""

    def __init__(self, member):
        self.session = open_member(member)
        self.heard = []
        self.session.declare_subscriber(
            "wonderland/backends/**", zenoh.handlers.Callback(self.heard.append, indirect=False)
        )

    def put(self, key, data):
        for piece, label in cut(data, os.urandom(8)):
            self.session.put(key, piece, attachment=label)

    async def ask(self, key, data, name=None):
        """(answers, refusals)"""
        answers, refusals, ended = [], [], asyncio.Event()
        loop = asyncio.get_running_loop()

        def replied(reply):
            if reply.ok is not None:
                answers.append(reply.ok.payload.to_bytes())
            else:
                refusals.append(reply.err.payload.to_bytes())

        ((piece, label),) = cut(data, name or os.urandom(16))
        handler = zenoh.handlers.Callback(replied, lambda: loop.call_soon_threadsafe(ended.set), indirect=False)
        await asyncio.to_thread(lambda: self.session.get(key, handler, payload=piece, attachment=label, timeout=5))
        await asyncio.wait_for(ended.wait(), 10)
        return answers, refusals


async def test_strangers_neither_hear_nor_feed_nor_command(replicas, field, tmp_path):
    bus = replicas.bus
    bus.organisations.trust("AuthorityMSP", "PadMSP", "EvilMSP")
    await bus.kill()
    await bus.start()
    first = await replicas.begin("backend-1")
    token = (await first.told())["token"]
    second = await replicas.begin("backend-2")
    await second.told()
    signed_in = await cookie(first.url, token)
    there = Console(second.url, cookie=signed_in)
    pad = Stranger(bus.organisations.member("PadMSP", "pad-1", bus.port))
    # Of a name that the router lets in, by an authority that it trusts, and not this database's.
    evil = Stranger(bus.organisations.member("EvilMSP", "backend-2", bus.port))
    database = Database(replicas.database)
    try:
        async with field.reporting(first.url):
            await field.prove()
            await eventually(lambda: set(field.proved) <= there.verdicts.keys())
            await eventually(lambda: evil.heard, what="the router lets that name listen")
            assert pad.heard == []
            async with client(second.url, signed_in) as http:
                assert (await http.post("/api/v1/search", json={"q": "SECRETWORD", "limit": 5})).status_code == 200
            everything = b"".join(each.payload.to_bytes() for each in evil.heard)
            assert signed_in.encode() not in everything
            assert b"delta" not in everything

            async with database.read() as session:
                instance, key = await queries.instance(session), await queries.bus_key(session)
            epoch, _ = there.place
            cookie_header = (b"cookie", signed_in.encode())
            sign_out = encode(
                Request(
                    method="DELETE", path="/api/v1/session", raw_path=b"/api/v1/session", query=b"",
                    headers=[(b"host", b"127.0.0.1"), cookie_header], body=b"", scheme="http", server=None,
                    client=("203.0.113.1", 1), peer_address="203.0.113.1", peer_certificate=None, peer_encrypted=False,
                )
            )  # fmt: skip
            for stranger in (pad, evil):
                for seq in range(there.place[1], there.place[1] + 300):
                    told = Told.of(epoch, Frame(seq, FORGED % (seq, now_ms(), now_ms()), Aside()))
                    plain = encode(told)
                    stranger.put(keys.frames(instance), plain)
                    stranger.put(keys.frames(instance), Seal(os.urandom(32)).closed(plain, b"", now_ms()))
                for request in (sign_out, Seal(os.urandom(32)).closed(sign_out, b"", now_ms())):
                    answers, _ = await stranger.ask(keys.requests(instance, epoch), request)
                    assert answers == []
                answers, _ = await stranger.ask(keys.state(instance, epoch), encode(Wanted()))
                assert answers == []
            # What was heard comes again: it is old, and is told to nobody twice.
            for each in evil.heard[-20:]:
                evil.session.put(str(each.key_expr), each.payload, attachment=each.attachment)
            seen = len(there.digests)
            await eventually(lambda: len(there.digests) > seen + 20)
            assert "FORGED" not in there.picture["tracks"]
            assert (there.holes, there.told_twice) == ([], [])
            async with client(first.url, signed_in) as http:
                assert (await http.get("/api/v1/session")).status_code == 200, "nobody was signed out"

            # Even a question of a backend's own is done once, and not when it is old.
            seal, name, at = Seal(bytes.fromhex(key)), os.urandom(16), keys.requests(instance, epoch)
            read = encode(
                Request(
                    method="GET", path="/api/v1/health", raw_path=b"/api/v1/health", query=b"",
                    headers=[(b"host", b"127.0.0.1")], body=b"", scheme="http", server=None, client=("203.0.113.1", 1),
                    peer_address="203.0.113.1", peer_certificate=None, peer_encrypted=False,
                )
            )  # fmt: skip
            about = at.encode() + b" ?" + name
            question = seal.closed(read, about, now_ms())
            answers, _ = await evil.ask(at, question, name)
            assert len(answers) == 1
            assert b"ok" not in answers[0]
            assert await evil.ask(at, question, name) == ([], [b"asked before"])
            other = os.urandom(16)
            assert await evil.ask(at, question, other) == ([], [b"refused"])
            old = seal.closed(read, at.encode() + b" ?" + other, now_ms() - 120_000)
            assert await evil.ask(at, old, other) == ([], [b"refused"])
    finally:
        await there.close()
        await database.close()
        for stranger in (pad, evil):
            await asyncio.to_thread(stranger.session.close)
    log = replicas.errors.read_text()
    assert "not of a backend of this database" in log, "the operator can see that somebody tries"
