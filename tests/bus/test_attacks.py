"""Liars on the bus: what Zenoh's access control lets through, the channel and its TLS have to hold."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import ssl
import sys
from collections.abc import AsyncIterator
from dataclasses import replace

import pytest
import zenoh
from kit import environment
from kit.bus import Organisations, free_port
from kit.ways import NAME

from wonderland_bus import backend, keys
from wonderland_bus.agent import Dialled, connect
from wonderland_bus.backend import Doorway, Listener
from wonderland_bus.channel import Channel
from wonderland_bus.errors import BusError, ChannelClosedError
from wonderland_bus.segments import Kind, Numbers, Segment, SegmentError, parse
from wonderland_bus.session import open_member, open_router
from wonderland_bus.settings import Member
from wonderland_fabric_gateway.ca import Kind as CaKind

SECRET = "only pad and backend know this"


@pytest.fixture(scope="module")
def organisations(tmp_path_factory):
    made = Organisations(tmp_path_factory.mktemp("organisations"))
    made.trust("AuthorityMSP", "PadMSP", "OtherMSP")  # the router lets a third organisation in, too
    return made


@pytest.fixture(scope="module")
def port(organisations):
    found = free_port()
    with open_router(organisations.router(found)):
        yield found


class Echo:
    """A backend that answers what it is told, and remembers from whom."""

    def __init__(self, organisations: Organisations, port: int) -> None:
        self.organisations = organisations
        self.port = port
        self.heard: list[str] = []
        self.reads = asyncio.Event()
        self.reads.set()

    @contextlib.asynccontextmanager
    async def listening(self, msp_id: str = "AuthorityMSP", name: str = "backend-1") -> AsyncIterator[Listener]:
        own = self.organisations.tls(msp_id, name, kind=CaKind.TLS, hosts=[NAME])
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(own.certificate, own.key)
        context.verify_mode = ssl.CERT_REQUIRED
        context.load_verify_locations(self.organisations.ca)
        listener = Listener(
            Doorway(
                member=Member(routers=[f"tls/localhost:{self.port}"], tls=own),
                context=context,
                max_channels=10,
                max_frame_bytes=256 * 1024,
            ),
            self._serve,
        )
        running = asyncio.create_task(listener.run())
        try:
            await listener.listening.wait()
            yield listener
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    async def _serve(self, channel: Channel, shown: bytes) -> None:
        with contextlib.suppress(ChannelClosedError):
            while True:
                await self.reads.wait()
                text = await channel.receive()
                self.heard.append(text)
                await channel.send(text[:100])


@pytest.fixture
def echo(organisations, port):
    return Echo(organisations, port)


def dialled(organisations, port, msp_id="PadMSP", name="pad-1", **options):
    tls = organisations.tls(msp_id, name)
    context = ssl.create_default_context(cafile=str(tls.ca))
    context.load_cert_chain(tls.certificate, tls.key)
    member = Member(routers=[f"tls/localhost:{port}"], tls=tls)
    return Dialled(member=member, server_name=NAME, context=context, **{"open_timeout_s": 3.0, **options})


async def asked(channel: Channel, text: str) -> str:
    await channel.send(text)
    return await asyncio.wait_for(channel.receive(), 5)


@contextlib.asynccontextmanager
async def spying(organisations, port, *, msp_id="OtherMSP", name="pad-1", wishes=("**",)):
    """A session of one who has a certificate, all that it hears, and a way to put."""
    heard: list[tuple[str, bytes]] = []
    session = await asyncio.to_thread(
        open_member, Member(routers=[f"tls/localhost:{port}"], tls=organisations.tls(msp_id, name))
    )
    for wish in wishes:
        session.declare_subscriber(
            wish,
            zenoh.handlers.Callback(
                lambda sample: heard.append((str(sample.key_expr), sample.payload.to_bytes())), indirect=False
            ),
            allowed_origin=zenoh.Locality.REMOTE,
        )
    await asyncio.sleep(0.3)
    try:
        yield session, heard
    finally:
        await asyncio.to_thread(session.close)


async def test_another_organisations_pad_1_reads_nothing_says_nothing_and_ends_nothing(organisations, port, echo):
    ours = organisations.tls("PadMSP", "pad-1").peer()
    places = f"{keys.AGENTS}/pad-1/*"
    wishes = ("**", keys.ALL_OPENINGS, f"{places}/up/*", f"{places}/down/*", f"{keys.AGENTS}/pad-1/{ours.issuer}/**")
    async with (
        echo.listening(),
        spying(organisations, port, wishes=wishes) as (spy, heard),
        connect(dialled(organisations, port)) as channel,
    ):
        assert await asked(channel, SECRET) == SECRET
        # Zenoh's access control lets it hear what goes down to a pad-1, whoever issued it: TLS, and no connection.
        assert heard
        assert not [key for key, _ in heard if "/up/" in key or "/open/" in key]
        assert SECRET.encode() not in b"".join(data for _, data in heard)
        servers = {parse(data).server for _, data in heard}
        for key, _ in list(heard):
            tail = key.rpartition("/")[2]
            for server in (*servers, 0):
                for segment in (
                    Segment(Kind.DATA, server, 0, 0, b"x" * 100),
                    Segment(Kind.DATA, server, 3, 3, b"x" * 100),
                    Segment(Kind.CREDIT, server, 99, 99),
                ):
                    for place in (
                        key,
                        keys.up(ours, tail),
                        f"{keys.AGENTS}/pad-1/{ours.issuer}/up/*",
                        f"{places}/up/**",
                    ):
                        spy.put(place, segment.encode(), congestion_control=zenoh.CongestionControl.BLOCK)
        await asyncio.sleep(0.3)
        for number in range(20):
            assert await asked(channel, f"still {number}") == f"still {number}"
    assert echo.heard == [SECRET, *(f"still {number}" for number in range(20))]


async def test_a_connection_at_the_place_of_another_organisations_pad_is_refused(
    organisations, port, echo, monkeypatch
):
    ours = organisations.tls("PadMSP", "pad-1").peer()
    async with echo.listening(), connect(dialled(organisations, port)) as channel:
        theirs = dialled(organisations, port, "OtherMSP")
        monkeypatch.setattr(type(theirs.member.tls), "peer", lambda _self: ours)
        async with connect(theirs) as liar:
            with pytest.raises(ChannelClosedError, match="pad-1 speaks at the place of pad-1, or of another") as caught:
                await asked(liar, "records")
            assert caught.value.code == 1008
        assert await asked(channel, SECRET) == SECRET
    assert echo.heard == [SECRET]


async def test_another_organisations_backend_gets_no_record_and_acknowledges_none(organisations, port, echo):
    async with echo.listening("OtherMSP", "backend-1"):
        with pytest.raises(ChannelClosedError, match="certificate verify failed"):
            async with connect(dialled(organisations, port)):
                pytest.fail("believed")
    assert echo.heard == []


async def test_a_backends_certificate_of_another_name_is_not_believed(organisations, port, echo):
    async with echo.listening():
        with pytest.raises(ChannelClosedError, match=r"certificate verify failed: Hostname mismatch"):
            async with connect(replace(dialled(organisations, port), server_name="other.example")):
                pytest.fail("believed")


async def test_an_agent_of_an_authority_that_the_backend_does_not_know(organisations, port, echo, monkeypatch):
    """The router lets it in, the ledger does not have its organisation."""
    monkeypatch.setattr(organisations, "ca", organisations.authority_ca)
    async with echo.listening(), connect(dialled(organisations, port, "OtherMSP")) as channel:
        with pytest.raises(ChannelClosedError, match="unknown ca"):
            await asked(channel, "records")
    assert echo.heard == []


async def test_a_certificate_is_demanded_within_too(organisations, port, echo):
    to = dialled(organisations, port)
    bare = ssl.create_default_context(cafile=str(to.member.tls.ca))
    async with echo.listening(), connect(replace(to, context=bare)) as channel:
        with pytest.raises(ChannelClosedError, match="certificate required"):
            await asked(channel, "records")
    assert echo.heard == []


async def test_who_sends_more_than_is_taken_is_cut_off_and_others_go_on(organisations, port, echo, monkeypatch):
    async with (
        echo.listening(),
        connect(dialled(organisations, port, name="pad-2")) as other,
        connect(dialled(organisations, port)) as flood,
    ):
        assert await asked(flood, "first") == "first"
        assert await asked(other, "first") == "first"
        echo.reads.clear()
        monkeypatch.setattr(Numbers, "may_send", property(lambda _self: True))
        with pytest.raises(ChannelClosedError, match="more than is taken") as caught:
            async with asyncio.timeout(20):
                while True:
                    await flood.send("x" * 60_000)
        assert caught.value.code == 1008
        monkeypatch.undo()
        echo.reads.set()
        assert await asked(other, "still there") == "still there"


async def test_who_reads_nothing_holds_up_nobody_and_costs_a_bounded_amount(organisations, port, echo):
    async with (
        echo.listening() as listener,
        connect(dialled(organisations, port, name="pad-2")) as other,
        connect(dialled(organisations, port)) as full,
    ):
        assert await asked(full, "first") == "first"
        assert await asked(other, "first") == "first"
        echo.reads.clear()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(2):
                while True:
                    await full.send("x" * 200_000)
        waiting = [sum(map(len, each._raw)) + sum(map(len, each._texts)) for each in listener._channels.values()]
        assert max(waiting) <= 32 * 65_600 + 16 * 200_000
        echo.reads.set()
        assert await asked(other, "there") == "there"
        while (await asyncio.wait_for(full.receive(), 10)) != "x" * 100:
            pass


async def test_a_frame_of_100_mb_ends_its_connection_alone(organisations, port, echo):
    async with (
        echo.listening(),
        connect(dialled(organisations, port, name="pad-2")) as other,
        connect(dialled(organisations, port)) as huge,
    ):
        with pytest.raises(ChannelClosedError, match="a frame of 104857600 bytes; at most 262144") as caught:
            await huge.send("x" * (100 << 20))
            await huge.receive()
        assert caught.value.code == 1009
        assert await asked(other, SECRET) == SECRET
    assert echo.heard == [SECRET]


async def test_rubbish_and_connections_that_come_to_nothing_shut_nobody_out(organisations, port, echo):
    me = organisations.tls("PadMSP", "pad-2").peer()
    async with echo.listening() as listener, spying(organisations, port, msp_id="PadMSP", name="pad-2") as (session, _):
        rubbish = [
            b"",
            b"x",
            os.urandom(200),
            os.urandom(70_000),
            Segment(Kind.DATA, 0, 0, 0, os.urandom(500)).encode(),
        ]
        for number in range(300):
            place = (keys.opening if number % 2 else keys.up)(me, f"{number:032x}")
            session.put(place, rubbish[number % len(rubbish)], congestion_control=zenoh.CongestionControl.BLOCK)
            session.put(place, Segment(Kind.DATA, 7, 3, 0, b"").encode())
        async with (
            connect(dialled(organisations, port)) as honest,
            connect(dialled(organisations, port, name="pad-2")) as same_name,
        ):
            assert await asked(honest, SECRET) == SECRET
            assert await asked(same_name, SECRET) == SECRET
            assert len(listener._shaking) <= backend.MAX_HANDSHAKES_EACH


@pytest.mark.parametrize("at", ["open", "up"])
async def test_a_flood_from_one_that_is_let_in_holds_up_nobody(organisations, port, echo, at):
    tls = organisations.tls("PadMSP", "pad-2")
    files = {"ca": str(tls.ca), "certificate": str(tls.certificate), "key": str(tls.key)}
    told = json.dumps({"tls": files, "routers": [f"tls/localhost:{port}"], "at": at})
    async with echo.listening() as listener:
        flood = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "kit.bus_flood",
            told,
            "8",
            stdout=asyncio.subprocess.PIPE,
            env=os.environ | environment(),
        )
        assert (await flood.stdout.readline()).strip() == b"ready"
        most = answered = 0
        async with connect(dialled(organisations, port, open_timeout_s=20.0)) as honest:
            while flood.returncode is None and not (flood.stdout._buffer):
                assert await asked(honest, f"{answered}") == f"{answered}"
                answered += 1
                most = max(most, len(listener._tasks))
        print("answered", answered, "flood", int(await flood.stdout.readline()))
        assert await flood.wait() == 0
    assert answered > 20
    assert most <= backend.MAX_HANDSHAKES_EACH + 2


async def test_silent_openings_of_one_name_give_way(organisations, port, echo):
    """Each is a real beginning of a handshake that nobody goes on with."""
    to = dialled(organisations, port, name="pad-2")
    async with echo.listening() as listener, spying(organisations, port, msp_id="PadMSP", name="pad-2") as (session, _):
        from wonderland_bus.secure import SecureStream

        for number in range(40):
            stream = SecureStream(to.context, server_name=NAME, max_frame_bytes=1)
            stream.shake()
            first = Segment(Kind.DATA, 0, 0, 0, stream.outgoing()).encode()
            session.put(keys.opening(to.member.tls.peer(), f"{number:032x}"), first)
            await asyncio.sleep(0.11)  # what comes faster the router drops
        async with asyncio.timeout(5):
            while not listener._shaking:
                await asyncio.sleep(0.01)
        async with connect(to) as channel:
            assert await asked(channel, SECRET) == SECRET
        assert len(listener._shaking) <= backend.MAX_HANDSHAKES_EACH


async def test_an_agent_that_the_router_does_not_list_is_told_what_to_look_at(organisations, port, echo):
    async with echo.listening():
        with pytest.raises(BusError, match=r"let pad-9 in, but no backend answers: .* pad-9 is not among its agents"):
            async with connect(dialled(organisations, port, name="pad-9", open_timeout_s=1.0)):
                pytest.fail("answered")


def test_numbers_that_are_not_the_next():
    numbers = Numbers()
    assert numbers.arrived(Segment(Kind.DATA, 1, 0, 0))
    assert not numbers.arrived(Segment(Kind.DATA, 1, 0, 0))  # twice
    assert numbers.arrived(Segment(Kind.DATA, 1, 1, 0))
    assert not numbers.arrived(Segment(Kind.CREDIT, 1, 2, 0))
    with pytest.raises(SegmentError, match="lost"):
        numbers.arrived(Segment(Kind.DATA, 1, 3, 0))
    with pytest.raises(SegmentError, match="lost"):
        numbers.arrived(Segment(Kind.CREDIT, 1, 3, 0))
    with pytest.raises(SegmentError, match="never sent"):
        numbers.arrived(Segment(Kind.DATA, 1, 2, 1))
