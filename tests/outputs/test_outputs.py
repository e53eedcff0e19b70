"""MQTT by a real broker, Cursor-on-Target by real sockets, and the live picture by REST."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import ssl
from xml.etree import ElementTree as ET

import aiomqtt
import pytest
import trustme
from kit.backend import serving
from kit.chain import START_MS
from kit.facts import Facts
from kit.mqtt_broker import Broker, free_port
from kit.openings import NUMBER

from wonderland_backend.clients.store import NewClient
from wonderland_backend.masking import masked

TRACK = {"uav_id": "uav-1", "lat_e7": 604_518_000, "lon_e7": 222_666_000, "transport": "wifi_beacon"}


@pytest.fixture
async def broker(tmp_path):
    made = Broker(tmp_path, needs_mosquitto=True)
    await made.start()
    yield made
    made.stop()


def a_chain(chain):
    """A pad, drones, and one decided session."""
    facts = Facts()
    chain.add(facts.put_pad(), facts.put_uav(), facts.put_uav("uav-2"))
    chain.add(facts.request("one"))
    chain.add(facts.decide("one"))
    return facts


async def hear(running, agent_client, **more):
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()
        assert (await agent.report(("track", TRACK | more)))["type"] == "ack"


class Listener:
    """Somebody else at the broker."""

    def __init__(self, client):
        self._messages = aiter(client.messages)

    async def next_of(self, topic):
        async with asyncio.timeout(20):
            while str((message := await anext(self._messages)).topic) != topic:
                pass
            return message


@contextlib.asynccontextmanager
async def listening(broker):
    async with aiomqtt.Client("127.0.0.1", broker.port, protocol=aiomqtt.ProtocolVersion.V5) as client:
        await client.subscribe("wonderland/#", qos=1)
        yield Listener(client)


async def test_mqtt_tells_each_thing_on_its_own_topic(new_backend, chain, source_of, agent_client, broker):
    a_chain(chain)
    outputs = {"mqtt": {"host": "127.0.0.1", "port": broker.port, "tls": False}}
    async with listening(broker) as listener:
        async with serving(new_backend(source_of(chain), outputs=outputs)) as running:
            assert (await listener.next_of("wonderland/v1/status")).payload == b"online"
            verdict = json.loads((await listener.next_of("wonderland/v1/verdicts/uav-1")).payload)
            assert (verdict["kind"], verdict["verified"], verdict["outcome"]) == ("verdict", True, "verified")
            await hear(running, agent_client, operator_id="FIN87astrdge12k8")
            claim = json.loads((await listener.next_of("wonderland/v1/claims/uav-1")).payload)
            assert (claim["kind"], claim["verified"], claim["lat_e7"]) == ("claim", False, TRACK["lat_e7"])
            assert "operator_id" not in claim
        assert (await listener.next_of("wonderland/v1/status")).payload == b"offline"
    async with listening(broker) as late:
        assert json.loads((await late.next_of("wonderland/v1/verdicts/uav-1")).payload) == verdict


async def test_mqtt_tells_what_was_decided_while_the_broker_was_away(
    new_backend, chain, source_of, broker, monkeypatch
):
    monkeypatch.setattr("wonderland_backend.outputs.mqtt.LONGEST_PAUSE_S", 0.2)
    facts = a_chain(chain)
    outputs = {"mqtt": {"host": "127.0.0.1", "port": broker.port, "tls": False, "tell": ["verdict"]}}
    async with serving(new_backend(source_of(chain), outputs=outputs)) as running:
        async with listening(broker) as listener:
            await listener.next_of("wonderland/v1/verdicts/uav-1")
        broker.stop()
        chain.add(facts.request("two", uav_id="uav-2", t_ms=START_MS + 10_000))
        chain.add(facts.decide("two", uav_id="uav-2", t_ms=START_MS + 10_000, outcome="refuted"))
        await running.mirrored(chain.height)
        await broker.start()
        async with listening(broker) as listener:
            told = json.loads((await listener.next_of("wonderland/v1/verdicts/uav-2")).payload)
            assert told["outcome"] == "refuted"


@contextlib.asynccontextmanager
async def only_3_1_1(broker):
    """The broker as one that knows no MQTT 5: whoever asks for that is refused as MQTT 3.1.1 has it. Gives its port."""

    async def pass_on(reader, writer):
        with contextlib.suppress(ConnectionError):
            while data := await reader.read(65_536):
                writer.write(data)
                await writer.drain()
        writer.close()

    async def serve(reader, writer):
        hello = await reader.readuntil(b"MQTT") + await reader.readexactly(1)
        if hello[-1] != 4:
            writer.write(b"\x20\x02\x00\x01")  # CONNACK: unacceptable protocol version
            writer.close()
            return
        onward, back = await asyncio.open_connection("127.0.0.1", broker.port)
        back.write(hello)
        await asyncio.gather(pass_on(reader, back), pass_on(onward, writer))

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    async with server:
        yield server.sockets[0].getsockname()[1]


async def test_mqtt_with_a_broker_that_knows_no_version_5(new_backend, chain, source_of, broker):
    a_chain(chain)
    async with only_3_1_1(broker) as port, listening(broker) as listener:
        with pytest.raises(aiomqtt.MqttError):
            async with aiomqtt.Client("127.0.0.1", port, protocol=aiomqtt.ProtocolVersion.V5):
                pass
        outputs = {"mqtt": {"host": "127.0.0.1", "port": port, "tls": False, "protocol": "3.1.1"}}
        async with serving(new_backend(source_of(chain), outputs=outputs)):
            assert (await listener.next_of("wonderland/v1/status")).payload == b"online"
            assert json.loads((await listener.next_of("wonderland/v1/verdicts/uav-1")).payload)["verified"]


class TakServer:
    """What a TAK server hears, event by event; it can go away and come back at the same port."""

    def __init__(self):
        self.port = free_port()
        self.heard = asyncio.Queue()
        self.peers = []
        self._writers = []
        self._server = None

    async def start(self, tls=None):
        self._server = await asyncio.start_server(self._receive, "127.0.0.1", self.port, ssl=tls)

    async def stop(self):
        self._server.close()
        for writer in self._writers:
            writer.close()
        self._writers.clear()
        await self._server.wait_closed()

    async def next_of(self, uid):
        async with asyncio.timeout(30):
            while (event := await self.heard.get()).get("uid") != uid:
                pass
            return event

    async def _receive(self, reader, writer):
        self._writers.append(writer)
        self.peers.append(writer.get_extra_info("peercert"))
        text = b""
        with contextlib.suppress(ConnectionError):
            while data := await reader.read(65_536):
                text += data
                while (end := text.find(b"</event>")) >= 0:
                    self.heard.put_nowait(ET.fromstring(text[: end + 8]))
                    text = text[end + 8 :]
        writer.close()


async def test_tak_gets_events_by_tcp_and_again_after_the_server_was_away(
    new_backend, chain, source_of, agent_client, monkeypatch
):
    monkeypatch.setattr("wonderland_backend.outputs.tak.LONGEST_PAUSE_S", 0.2)
    facts = a_chain(chain)
    tak = TakServer()
    await tak.start()
    outputs = {"tak": {"url": f"tcp://127.0.0.1:{tak.port}", "period_ms": 0}}
    async with serving(new_backend(source_of(chain), outputs=outputs)) as running:
        verdict = await tak.next_of("wonderland.uav-1.verdict")
        assert verdict.find("detail/__wonderland").get("outcome") == "verified"
        await hear(running, agent_client)
        claim = await tak.next_of("wonderland.uav-1.claim")
        assert claim.find("point").get("lat") == "60.4518000"
        await tak.stop()
        await tak.start()
        chain.add(facts.request("two", uav_id="uav-2", t_ms=START_MS + 10_000))
        chain.add(facts.decide("two", uav_id="uav-2", t_ms=START_MS + 10_000, outcome="refuted"))
        await running.mirrored(chain.height)
        told = await tak.next_of("wonderland.uav-2.verdict")
        assert told.find("detail/__wonderland").get("outcome") == "refuted"
    await tak.stop()


@pytest.mark.filterwarnings("ignore:ssl.OP_NO:DeprecationWarning")  # pytak
async def test_tak_by_tls_with_certificates_on_both_sides(new_backend, chain, source_of, tmp_path):
    a_chain(chain)
    ca = trustme.CA()
    authority, own = tmp_path / "ca.pem", tmp_path / "own.pem"
    ca.cert_pem.write_to_path(authority)
    ca.issue_cert("wonderland.example").private_key_and_cert_chain_pem.write_to_path(own)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    ca.issue_cert("127.0.0.1").configure_cert(context)
    ca.configure_trust(context)
    context.verify_mode = ssl.CERT_REQUIRED
    tak = TakServer()
    await tak.start(context)
    files = {"tls_certificate": own, "tls_key": own, "tls_ca": authority}
    outputs = {"tak": {"url": f"tls://127.0.0.1:{tak.port}"} | files}
    async with serving(new_backend(source_of(chain), outputs=outputs)):
        assert (await tak.next_of("wonderland.uav-1.verdict")).get("type") == "b-m-p-s-m"
    assert tak.peers[0]["subjectAltName"] == (("DNS", "wonderland.example"),)
    await tak.stop()


async def test_neither_mqtt_nor_tak_tells_an_operator(new_backend, chain, source_of, agent_client, broker):
    """Registered and broadcast numbers, the operator id and where an operator stands: in nothing that goes out."""
    facts = Facts()
    chain.add(facts.put_pad(operator_id="zq-harbour"), facts.put_uav(operator_id="zq-aviation"))
    chain.add(facts.request("one"))
    chain.add(facts.decide("one", outcome="refuted"))
    tak = TakServer()
    await tak.start()
    outputs = {
        "mqtt": {"host": "127.0.0.1", "port": broker.port, "tls": False},
        "tak": {"url": f"tcp://127.0.0.1:{tak.port}", "period_ms": 0},
    }
    told = []
    async with aiomqtt.Client("127.0.0.1", broker.port, protocol=aiomqtt.ProtocolVersion.V5) as client:
        await client.subscribe("#", qos=1)
        async with serving(new_backend(source_of(chain), outputs=outputs)) as running:
            spoken = {"operator_id": "SWE00zqbroadcst1", "operator_lat_e7": 604_511_117, "operator_lon_e7": 222_611_117}
            await hear(running, agent_client, **spoken)
            async with asyncio.timeout(30):
                while not {"claims", "verdicts"} <= {each.split("/")[2] for each, _ in told if each.count("/") == 3}:
                    message = await anext(aiter(client.messages))
                    told.append((str(message.topic), message.payload.decode()))
            for kind in ("verdict", "claim"):
                event = await tak.next_of(f"wonderland.uav-1.{kind}")
                told.append((kind, ET.tostring(event).decode()))
    await tak.stop()
    assert {"verdict", "claim"} <= {where for where, _ in told}
    for secret in (NUMBER, masked(NUMBER), "SWE00zqbroadcst1", "zq-", "604511117", "60.4511117", "22.2611117"):
        assert [where for where, text in told if secret in text or secret in where] == [], secret


@pytest.mark.filterwarnings("ignore:ssl.OP_NO:DeprecationWarning")  # pytak
async def test_tak_does_not_speak_to_a_server_of_another_authority(new_backend, chain, source_of, tmp_path, caplog):
    a_chain(chain)
    ca, other = trustme.CA(), trustme.CA()
    authority, own = tmp_path / "ca.pem", tmp_path / "own.pem"
    ca.cert_pem.write_to_path(authority)
    ca.issue_cert("wonderland.example").private_key_and_cert_chain_pem.write_to_path(own)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    other.issue_cert("127.0.0.1").configure_cert(context)
    tak = TakServer()
    await tak.start(context)
    files = {"tls_certificate": own, "tls_key": own, "tls_ca": authority}
    outputs = {"tak": {"url": f"tls://127.0.0.1:{tak.port}"} | files}
    async with serving(new_backend(source_of(chain), outputs=outputs)):
        async with asyncio.timeout(20):
            while "is away" not in caplog.text:
                await asyncio.sleep(0.05)
    assert "Could not verify TLS Certificate" in caplog.text
    assert tak.heard.empty()
    await tak.stop()


async def test_mqtt_by_tls(new_backend, chain, source_of, tmp_path):
    a_chain(chain)
    ca = trustme.CA()
    authority, own = tmp_path / "ca.pem", tmp_path / "own.pem"
    ca.cert_pem.write_to_path(authority)
    ca.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(own)
    broker = Broker(tmp_path, tls=(own, authority))
    await broker.start()
    try:
        outputs = {"mqtt": {"host": "127.0.0.1", "port": broker.port, "tls_ca": authority}}
        async with serving(new_backend(source_of(chain), outputs=outputs)):
            trusted = ssl.create_default_context(cafile=authority)
            version = aiomqtt.ProtocolVersion.V5
            async with aiomqtt.Client("127.0.0.1", broker.port, protocol=version, tls_context=trusted) as client:
                await client.subscribe("wonderland/#", qos=1)
                told = json.loads((await Listener(client).next_of("wonderland/v1/verdicts/uav-1")).payload)
                assert told["outcome"] == "verified"
    finally:
        broker.stop()


async def test_tak_gets_events_by_udp_and_only_those_that_are_switched_on(new_backend, chain, source_of, agent_client):
    a_chain(chain)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.setblocking(False)
        url = f"udp://127.0.0.1:{receiver.getsockname()[1]}"
        outputs = {"tak": {"url": url, "tell": ["claim"]}}
        async with serving(new_backend(source_of(chain), outputs=outputs)) as running:
            await running.mirrored(chain.height)
            await hear(running, agent_client)
            async with asyncio.timeout(10):
                datagram = await asyncio.get_running_loop().sock_recv(receiver, 65_536)
            assert ET.fromstring(datagram).get("uid") == "wonderland.uav-1.claim"


async def test_the_live_picture_has_each_thing_as_a_feature(running, agent_client):
    await hear(running, agent_client)
    answer = await running.get("/picture")
    assert answer.headers["content-type"] == "application/geo+json"
    features = {feature["id"]: feature for feature in answer.json()["features"]}
    assert {"claim/uav-1", "verdict/uav-1", "verdict/uav-2"} <= features.keys()
    assert features["claim/uav-1"]["geometry"]["coordinates"][:2] == [22.2666, 60.4518]
    assert features["verdict/uav-2"]["properties"]["outcome"] == "refuted"
    assert (await running.get("/picture", headers={"If-None-Match": answer.headers["etag"]})).status_code == 304
    only = await running.json("/picture", tell="verdict")
    assert {feature["properties"]["kind"] for feature in only["features"]} == {"verdict"}


async def test_a_machine_gets_of_the_picture_what_its_scopes_open(running, agent_client):
    await hear(running, agent_client)
    wanted = NewClient("Map", ("wonderland.tracks.read",))
    async with running.context.database.write() as connection:
        client, secret = await running.parts.clients.add(connection, wanted, "a test")
    form = {"grant_type": "client_credentials"}
    answer = await running.http.post("/oauth/token", data=form, auth=(client.client_id, secret))
    bearer = {"Authorization": f"Bearer {answer.json()['access_token']}"}
    running.http.cookies.clear()
    features = (await running.get("/picture", headers=bearer)).json()["features"]
    assert {feature["properties"]["kind"] for feature in features} == {"claim"}
    refused = await running.get("/picture", params={"tell": "verdict"}, headers=bearer)
    assert refused.status_code == 403
    assert "wonderland.proofs.read" in refused.text


async def test_the_live_picture_can_be_switched_off(new_backend, serving):
    async with serving(new_backend(outputs={"live_geojson": False})) as client:
        answer = await client.get("/picture", headers={"Accept-Language": "fi"})
        assert (answer.status_code, answer.json()["type"]) == (404, "urn:wonderland:problem:switched-off")
        assert "Reaaliaikainen GeoJSON ei ole käytössä" in answer.json()["detail"]
        told = (await client.json("/status"))["server"]["outputs"]
        assert told == {"tak": False, "mqtt": False, "live_geojson": False, "exports": ["geojson", "csv", "mfjson"]}
