"""``wonderland bus``, and an address of a bus in a pad's settings: what is wrong is said, and what to do."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from dataclasses import replace

import pytest
from click.testing import CliRunner
from kit.bus import HOST, Organisations, free_port
from kit.service_manager import manager, next_said

from wonderland_backend.bus_commands import bus
from wonderland_backend.errors import SettingsError
from wonderland_backend.ingest.bus import member_of
from wonderland_backend.ingest.bus_ingest import bus_ingest
from wonderland_backend.settings.bus import BusSettings
from wonderland_bus.errors import BusUnreachableError
from wonderland_bus.session import open_member
from wonderland_edge_agent.settings import BackendSettings
from wonderland_edge_agent.uplink import UplinkConfigurationError, way_to
from wonderland_fabric_gateway.connection import ClientTls


@pytest.fixture
def organisations(tmp_path):
    return Organisations(tmp_path)


def written(organisations, port, **more):
    router = organisations.router(port)
    fields = {
        "listen": [f"tls/{HOST}:{port}"],
        "ca": str(router.tls.ca),
        "certificate": str(router.tls.certificate),
        "key": str(router.tls.key),
        "agents": ["pad-1"],
        "backends": ["backend-1"],
    } | more
    path = organisations.directory / "router.toml"
    path.write_text("".join(f"{name} = {value!r}\n" for name, value in fields.items()))
    return path


def check(path):
    return CliRunner().invoke(bus, ["serve", "--check", "--config", str(path)])


def test_a_check_says_what_is_allowed(organisations):
    answer = check(written(organisations, 7447))
    assert answer.exit_code == 0
    assert answer.output == (f"tls/{HOST}:7447: agents pad-1; backends backend-1; nobody else is allowed anything\n")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"agents": ["**"]}, "agents: '**' is no common name"),
        ({"agents": 3}, "agents is 3, expected a list"),
        ({"agent": ["pad-1"]}, "agent"),
        ({"listen": ["tcp/0.0.0.0:7447"]}, "there is no bus without TLS"),
        ({"backends": ["pad-1"]}, "pad-1 is among agents and among backends"),
        ({"agents": []}, "agents: none, so that nobody would meet"),
        ({"backends": []}, "backends: none, so that nobody would meet"),
        ({"key": "/nowhere.key"}, "key: /nowhere.key cannot be read"),
        ({"certificate": ""}, "certificate is empty"),
    ],
)
def test_settings_that_cannot_be_used_are_refused(organisations, change, says):
    answer = check(written(organisations, 7447, **change))
    assert answer.exit_code == 1
    assert says in answer.output
    assert "Traceback" not in answer.output


def test_a_missing_extra_is_named(organisations, monkeypatch):
    for name in [each for each in sys.modules if each.startswith("wonderland_bus")]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "wonderland_edge_agent.uplink.zenoh", raising=False)
    monkeypatch.delitem(sys.modules, "wonderland_backend.ingest.bus", raising=False)
    answer = check(written(organisations, 7447))
    assert answer.exit_code == 1
    assert 'pip install "wonderland-backend[zenoh]"' in answer.output
    with pytest.raises(UplinkConfigurationError, match=r'pip install "wonderland-edge-agent\[zenoh\]"'):
        way_to("zenoh+tls://router.example/", ca=organisations.ca, client=None)
    settings = BusSettings(routers=("tls/router.example:7447",), ca="a", certificate="b", key="c")
    with pytest.raises(SettingsError, match=r'pip install "wonderland-backend\[zenoh\]"'):
        bus_ingest(settings, None, None)


def test_a_backends_settings_are_checked_when_it_starts(organisations):
    own = organisations.tls("AuthorityMSP", "backend-1")
    settings = BusSettings(routers=("tcp/router:1",), ca=own.ca, certificate=own.certificate, key=own.key)
    with pytest.raises(SettingsError, match=r"bus: routers: .* no bus without TLS"):
        member_of(settings)


@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("zenoh+tls://", "no address of a bus, for example"),
        ("zenoh+tls://user@router.example:7447/x", "no address of a bus"),
        ("zenoh+tls://router.example:7447/a/b", "no address of a bus"),
        ("zenoh+tls://router.example:99999/", "no address of the bus"),
    ],
)
def test_addresses_of_no_bus(organisations, url, says):
    tls = organisations.tls("PadMSP", "pad-1")
    with pytest.raises(UplinkConfigurationError, match=says):
        way_to(url, ca=tls.ca, client=ClientTls(tls.certificate, tls.key))


def test_an_address_of_a_bus_needs_its_authority_and_a_key_in_a_file(organisations):
    url = "zenoh+tls://one.example,two.example:7448/backend.example"
    tls = organisations.tls("PadMSP", "pad-1")
    client = ClientTls(tls.certificate, tls.key)
    assert BackendSettings(url=url).url == url
    with pytest.raises(UplinkConfigurationError, match="tls_ca is missing"):
        way_to(url, ca=None, client=client)
    with pytest.raises(UplinkConfigurationError, match=r"client_tls in connection\.json"):
        way_to(url, ca=tls.ca, client=None)
    way = way_to(url, ca=tls.ca, client=client)
    assert way._member.routers == ["tls/one.example:7447", "tls/two.example:7448"]
    assert way._server_name == "backend.example"
    assert way_to("zenoh+tls://one.example/", ca=tls.ca, client=client)._server_name == "one.example"


async def test_a_router_tells_the_service_manager(organisations, tmp_path):
    with manager(tmp_path) as (told, environment):
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "wonderland.cli", "bus", "serve", "--config", str(written(organisations, free_port())),
            env={**os.environ, **environment}, stdout=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
        try:
            assert await next_said(told) == "READY=1"
            process.terminate()
            assert await next_said(told) == "STOPPING=1"
        finally:
            if process.returncode is None:
                process.terminate()
            assert await process.wait() == 0


async def test_a_router_takes_a_new_list_and_none_that_is_wrong(organisations):
    port = free_port()
    path = written(organisations, port)
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "wonderland.cli", "bus", "serve", "--config", str(path),
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT,
    )  # fmt: skip

    async def says(what):
        async with asyncio.timeout(30):
            while what not in (line := (await process.stdout.readline()).decode()):
                assert line, "it has ended"

    stranger = organisations.tls("StrangeMSP", "pad-1")
    member = replace(organisations.member("PadMSP", "pad-1", port), patience_ms=300)
    try:
        await says("agents pad-1;")
        with pytest.raises(BusUnreachableError, match="does not know the authority"):
            await asyncio.to_thread(open_member, replace(member, tls=stranger))
        await says("UnknownIssuer")  # who was refused, and why
        written(organisations, port, agents=["*"])
        process.send_signal(signal.SIGHUP)
        await says("goes on as before: agents: '*' is no common name")
        written(organisations, port, agents=["pad-1", "pad-2"])
        process.send_signal(signal.SIGHUP)
        await says("agents pad-1, pad-2;")
        session = await asyncio.to_thread(open_member, member)
        await asyncio.to_thread(session.close)
    finally:
        process.terminate()
        assert await process.wait() == 0
