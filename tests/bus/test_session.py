"""Who gets onto the bus, and what he may do there: real certificates, a real router."""

from __future__ import annotations

import socket
import ssl
import threading
import time
from dataclasses import replace

import pytest
import zenoh
from kit.bus import HOST, Organisations, free_port

from wonderland_bus import keys, session
from wonderland_bus.errors import BusError, BusSettingsError, BusUnreachableError
from wonderland_bus.identity import Peer
from wonderland_bus.session import links_changed, open_member, open_router
from wonderland_bus.settings import MAX_MESSAGE_BYTES, Member, Router

EVERY_UP = f"{keys.AGENTS}/*/*/up/*"
CONNECTION = "0123456789abcdef" * 2


@pytest.fixture(scope="module")
def organisations(tmp_path_factory):
    return Organisations(tmp_path_factory.mktemp("organisations"))


@pytest.fixture(scope="module")
def port(organisations):
    found = free_port()
    with open_router(organisations.router(found)):
        yield found


class Heard:
    """A session and what its subscriptions bring."""

    def __init__(self, member: Member) -> None:
        self.session = open_member(member)
        self.peer = member.tls.peer()
        self._messages: list[tuple[str, bytes]] = []
        self._changed = threading.Condition()

    def subscribe(self, key: str) -> None:
        self.session.declare_subscriber(
            key, zenoh.handlers.Callback(self._take, indirect=False), allowed_origin=zenoh.Locality.REMOTE
        )

    def _take(self, sample: zenoh.Sample) -> None:
        with self._changed:
            self._messages.append((str(sample.key_expr), sample.payload.to_bytes()))
            self._changed.notify_all()

    def put(self, key: str, data: bytes) -> None:
        self.session.put(key, data, congestion_control=zenoh.CongestionControl.BLOCK)

    def until(self, data: bytes) -> list[tuple[str, bytes]]:
        with self._changed:
            assert self._changed.wait_for(lambda: any(each[1] == data for each in self._messages), 10), self._messages
            return list(self._messages)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.session.close()


@pytest.fixture
def on_the_bus(organisations, port):
    opened = []

    def join(msp_id: str, name: str) -> Heard:
        opened.append(Heard(organisations.member(msp_id, name, port)))
        return opened[-1]

    yield join
    for each in opened:
        each.session.close()


def in_force(*pairs: tuple[Heard, Heard, str]) -> None:
    """Wait until what a subscriber wants is known where others put it."""
    for number, (sender, hearer, key) in enumerate(pairs):
        mark, deadline = b"in force %d" % number, time.monotonic() + 10
        while time.monotonic() < deadline:
            sender.put(key, mark)
            with hearer._changed:
                if hearer._changed.wait_for(lambda: any(e[1] == mark for e in hearer._messages), 0.1):  # noqa: B023
                    break
        else:
            raise AssertionError(f"{key} is not heard")


def opened_as(monkeypatch, join, **settings):
    """A session of one who does not keep to what this project's sessions are."""
    usual = session._member_settings
    with monkeypatch.context() as patch:
        patch.setattr(session, "_member_settings", lambda member: usual(member) | settings)
        return join()


@pytest.mark.parametrize("mode", ["client", "peer", "router"])
def test_agents_and_backends_hear_one_another_and_nobody_else_anything(on_the_bus, monkeypatch, mode):
    """Not even one that calls itself a router."""
    backend, other_backend = on_the_bus("AuthorityMSP", "backend-1"), on_the_bus("AuthorityMSP", "backend-2")
    pad = on_the_bus("PadMSP", "pad-1")
    thief = opened_as(monkeypatch, lambda: on_the_bus("PadMSP", "pad-2"), mode=mode)
    up, down = keys.up(pad.peer, CONNECTION), keys.down(pad.peer, CONNECTION)
    backend.subscribe(EVERY_UP)
    other_backend.subscribe(f"{keys.BACKENDS}/**")
    pad.subscribe(down)
    for wish in ("**", "wonderland/**", EVERY_UP, up, down, f"{keys.BACKENDS}/**"):
        thief.subscribe(wish)
    thief.subscribe(keys.down(thief.peer, CONNECTION))
    in_force((pad, backend, up), (backend, pad, down), (backend, other_backend, f"{keys.BACKENDS}/live"))
    if mode != "router":
        in_force((thief, backend, keys.up(thief.peer, CONNECTION)), (backend, thief, keys.down(thief.peer, CONNECTION)))
    # Others' keys: another pad's, those of backends, of agents that there are not, and one's own wrong way.
    for key in (up, down, f"{keys.BACKENDS}/live", keys.down(thief.peer, CONNECTION), "elsewhere", f"{up}/more"):
        thief.put(key, b"forged")
    (pad if mode == "router" else thief).put(keys.up((pad if mode == "router" else thief).peer, CONNECTION), b"last")
    heard = backend.until(b"last")
    backend.put(down, b"last")
    pad.until(b"last")
    backend.put(f"{keys.BACKENDS}/live", b"last")
    other_backend.until(b"last")
    assert (up, b"in force 0") in heard
    for hearer in (backend, other_backend, pad):
        assert b"forged" not in {data for _, data in hearer._messages}
    if mode == "router":  # what it asks for as one is not even its own
        assert thief._messages == []
        return
    backend.put(keys.down(thief.peer, CONNECTION), b"the end")
    assert {key for key, _ in thief.until(b"the end")} == {keys.down(thief.peer, CONNECTION)}


def test_who_gives_itself_anothers_session_id_gets_nowhere_and_ends_nobody(
    on_the_bus, organisations, port, monkeypatch
):
    backend, pad = on_the_bus("AuthorityMSP", "backend-1"), on_the_bus("PadMSP", "pad-1")
    up = keys.up(pad.peer, CONNECTION)
    backend.subscribe(EVERY_UP)
    in_force((pad, backend, up))
    seen: list[bool] = []
    listeners = [links_changed(each.session, seen.append) for each in (pad, backend)]
    (router,) = pad.session.info.routers_zid()
    thief = replace(organisations.member("PadMSP", "pad-2", port), patience_ms=300)
    for stolen in (pad.session.info.zid(), backend.session.info.zid(), router):
        with pytest.raises(BusUnreachableError):
            opened_as(monkeypatch, lambda: open_member(thief), id=str(stolen))
    pad.put(up, b"still here")
    backend.until(b"still here")
    assert seen == [True, True]
    for each in listeners:
        each.undeclare()


def test_another_organisations_pad_1_is_not_let_in_by_an_authority_that_the_bus_does_not_know(organisations, port):
    stranger = organisations.tls("StrangeMSP", "pad-1")
    with pytest.raises(BusUnreachableError, match=r"does not know the authority that issued this certificate"):
        open_member(Member(routers=[f"tls/{HOST}:{port}"], tls=stranger, patience_ms=500))


def test_nobody_gets_in_without_a_certificate(organisations, port):
    context = ssl.create_default_context(cafile=organisations.ca)
    with (
        socket.create_connection((HOST, port)) as plain,
        context.wrap_socket(plain, server_hostname=HOST) as link,
        pytest.raises(ssl.SSLError, match="CERTIFICATE_REQUIRED"),
    ):
        link.recv(1)


def test_an_expired_certificate_is_refused_here_and_by_the_router(tmp_path, monkeypatch):
    organisations = Organisations(tmp_path)
    expired = organisations.expired("PadMSP", "pad-1")
    member = Member(routers=[f"tls/{HOST}:{free_port()}"], tls=expired, patience_ms=500)
    with pytest.raises(BusSettingsError, match=r"certificate: .*pad-1\.pem expired at .* UTC; renew it"):
        open_member(member)
    monkeypatch.setattr(type(expired), "check", lambda _self: None)
    port = free_port()
    with (
        open_router(organisations.router(port)),
        pytest.raises(BusUnreachableError, match="says that this certificate has expired"),
    ):
        open_member(replace(member, routers=[f"tls/{HOST}:{port}"]))


def test_a_router_that_is_another_or_away(organisations, port):
    member = organisations.member("PadMSP", "pad-1", port)
    with pytest.raises(BusUnreachableError, match=r"127\.0\.0\.1:\d+ shows a certificate that is not believed"):
        open_member(replace(member, routers=[f"tls/127.0.0.1:{port}"], patience_ms=500))
    with pytest.raises(BusUnreachableError, match="is not reached"):
        open_member(replace(member, routers=[f"tls/{HOST}:{free_port()}"], patience_ms=500))
    with open_member(replace(member, routers=[f"tls/{HOST}:{free_port()}", f"tls/{HOST}:{port}"])) as opened:
        assert opened.info.routers_zid()


def test_what_is_longer_than_a_message_may_be_gets_nowhere_and_harms_nobody(on_the_bus):
    backend, pad = on_the_bus("AuthorityMSP", "backend-1"), on_the_bus("PadMSP", "pad-1")
    up = keys.up(pad.peer, CONNECTION)
    backend.subscribe(EVERY_UP)
    in_force((pad, backend, up))
    pad.put(up, b"x" * (100 << 20))
    pad.put(up, b"y" * (MAX_MESSAGE_BYTES + 1024))
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline and not any(data == b"next" for _, data in backend._messages):
        pad.put(up, b"next")
        time.sleep(0.05)
    assert max(len(data) for _, data in backend.until(b"next")) <= MAX_MESSAGE_BYTES


def test_a_session_outlives_its_router(organisations):
    port = free_port()
    router = open_router(organisations.router(port))
    seen: list[bool] = []
    changed = threading.Condition()

    def tell(found: bool) -> None:
        with changed:
            seen.append(found)
            changed.notify_all()

    with (
        Heard(organisations.member("AuthorityMSP", "backend-1", port)) as backend,
        Heard(organisations.member("PadMSP", "pad-1", port)) as pad,
    ):
        listener = links_changed(pad.session, tell)
        backend.subscribe(EVERY_UP)
        up = keys.up(pad.peer, CONNECTION)
        in_force((pad, backend, up))
        router.close()
        with changed:
            assert changed.wait_for(lambda: seen == [True, False], 10), seen
        pad.put(up, b"lost")
        router = open_router(organisations.router(port))
        with changed:
            assert changed.wait_for(lambda: seen == [True, False, True], 20), seen
        backend._messages.clear()
        in_force((pad, backend, up))
        assert b"lost" not in {data for _, data in backend._messages}  # put never fails; so acknowledge
        listener.undeclare()
    router.close()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"routers": []}, "routers: none"),
        ({"routers": ["tcp/localhost:7447"]}, "no bus without TLS"),
        ({"routers": ["tls/localhost:99999"]}, "no address of the bus"),
    ],
)
def test_settings_of_a_session_that_cannot_work(organisations, change, says):
    with pytest.raises(BusSettingsError, match=says):
        replace(organisations.member("PadMSP", "pad-1", 7447), **change).check()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"listen": []}, "listen: nothing"),
        ({"listen": ["udp/localhost:1"]}, "no address of the bus"),
        ({"agents": ["pad-1/**"]}, "agents: 'pad-1/\\*\\*' is no common name"),
        ({"agents": ["*"]}, "no common name"),
        ({"agents": ["pad-1", "pad-1"]}, "twice"),
        ({"agents": ["backend-1"]}, "among agents and among backends"),
    ],
)
def test_settings_of_a_router_that_cannot_work(organisations, change, says):
    with pytest.raises(BusSettingsError, match=says):
        replace(organisations.router(7447), **change).check()


def test_files_that_are_none(organisations, tmp_path):
    good = organisations.tls("PadMSP", "pad-1")
    garbage = tmp_path / "garbage.pem"
    garbage.write_text("nothing")
    for change, says in (
        ({"ca": garbage}, "ca: .* holds no certificate"),
        ({"certificate": garbage}, "certificate: .* holds no certificate"),
        ({"key": garbage}, "key: .* is no private key"),
        ({"key": organisations.tls("PadMSP", "pad-2").key}, "is not the key of"),
        ({"ca": tmp_path / "none.pem"}, "ca: .* cannot be read"),
    ):
        with pytest.raises(BusSettingsError, match=says):
            replace(good, **change).check()


def test_an_address_that_somebody_has(organisations, port):
    with pytest.raises(BusError, match="no session of Zenoh"):
        open_router(organisations.router(port))


def test_names_are_of_two_organisations(organisations):
    ours, theirs = (organisations.tls(msp_id, "pad-1").peer() for msp_id in ("PadMSP", "OtherMSP"))
    assert ours.name == theirs.name == "pad-1"
    assert ours != theirs
    assert keys.parse_opening(keys.opening(ours, CONNECTION)) == (ours, CONNECTION)
    assert keys.parse_opening(keys.down(ours, CONNECTION)) is None
    assert keys.parse_opening(f"{keys.AGENTS}/pad-1/{ours.issuer}/open/*") is None
    assert CONNECTION not in keys.down(ours, CONNECTION)
    assert Router(tls=organisations.tls("PadMSP", "pad-1")).agents == ()
    assert ours == Peer("pad-1", ours.issuer)
