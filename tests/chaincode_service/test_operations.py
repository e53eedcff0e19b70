"""What an operator sees: health, metrics, logs."""

from __future__ import annotations

import asyncio
import json
import logging
import sys

import httpx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from prometheus_client.parser import text_string_to_metric_families

from wonderland_chaincode.service.errors import SettingsError
from wonderland_chaincode.service.logs import JsonLines
from wonderland_chaincode.service.metrics import BUCKETS_S, Metrics
from wonderland_chaincode.service.operations import Operations


@pytest.fixture
async def operations(world):
    listener = Operations(world.server)
    await listener.start("127.0.0.1:0")
    yield listener
    await listener.stop()


async def raw(address, data, *, close=False):
    host, port = address.rsplit(":", 1)
    reader, writer = await asyncio.open_connection(host, int(port))
    writer.write(data)
    if close:
        writer.write_eof()
    try:
        return await asyncio.wait_for(reader.read(), 10)
    finally:
        writer.close()
        await writer.wait_closed()


async def test_health_tells_who_is_served(tools, world, operations):
    peer = await world.peer()
    await peer.run(tools.Call("get", ("a",)))
    async with httpx.AsyncClient(base_url=f"http://{operations.address}", trust_env=False) as client:
        answer = await client.get("/healthz")
        assert answer.status_code == 200
        found = answer.json()
        assert (found["status"], found["package_id"], found["in_flight"]) == ("OK", tools.PACKAGE_ID, 0)
        assert len(found["peers"]) == 1
        world.server.draining = True
        answer = await client.get("/healthz")
        assert answer.status_code == 503
        assert answer.json()["failed_checks"] == [{"component": "contract", "reason": "it is stopping"}]
        assert (await client.get("/")).status_code == 404
        assert (await client.post("/healthz")).status_code == 405
        head = await client.head("/healthz?x=1")
        assert (head.status_code, head.content) == (503, b"")


async def test_metrics_are_read_by_prometheus(tools, world, operations):
    peer = await world.peer(tools.State(a="1"))
    for function, args in (("get", ("a",)), ("get", ("b",)), ("crash", ()), ("made_up", ()), ("refuse", ("404", "x"))):
        await peer.run(tools.Call(function, args))
    async with httpx.AsyncClient(base_url=f"http://{operations.address}", trust_env=False) as client:
        answer = await client.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    families = {family.name: family for family in text_string_to_metric_families(answer.text)}
    ended = {
        (sample.labels["function"], sample.labels["outcome"]): sample.value
        for sample in families["wonderland_contract_transactions"].samples
    }
    assert ended == {("get", "ok"): 2, ("crash", "fault"): 1, ("other", "fault"): 1, ("other", "refused"): 1}
    assert families["wonderland_contract_transaction_seconds"].type == "histogram"
    calls = {sample.labels["kind"]: sample.value for sample in families["wonderland_contract_peer_calls"].samples}
    assert calls == {"GET_STATE": 2}
    assert families["process_resident_memory_bytes"].samples[0].value > 1e7
    assert families["wonderland_contract_streams"].samples[0].value == 1


@settings(deadline=None, max_examples=50)
@given(st.lists(st.floats(0, 100), max_size=50), st.text(max_size=30))
def test_any_measurement_is_a_valid_exposition(seconds, version):
    metrics = Metrics({"f"})
    metrics.info.set(1, version=version)
    for each in seconds:
        metrics.finished("f", "ok", each)
    families = {each.name: each for each in text_string_to_metric_families(metrics.exposition().decode())}
    (info,) = families["wonderland_contract_info"].samples
    assert info.labels["version"] == version
    if seconds:
        samples = families["wonderland_contract_transaction_seconds"].samples
        buckets = [each for each in samples if each.name.endswith("_bucket")]
        assert [each.value for each in buckets] == [
            *(sum(each <= bound for each in seconds) for bound in BUCKETS_S), len(seconds),
        ]  # fmt: skip
        (total,) = [each.value for each in samples if each.name.endswith("_sum")]
        assert total == pytest.approx(sum(seconds))


@pytest.mark.parametrize(
    "data", [b"\r\n\r\n", b"GET\r\n\r\n", b"\xff\x00 /metrics\r\n\r\n", b"GET /\xff HTTP/1.1\r\n\r\n"]
)
async def test_requests_that_are_none_get_an_answer(operations, data):
    assert (await raw(operations.address, data)).startswith(b"HTTP/1.1 40")


async def test_a_request_without_end_is_cut_off(operations):
    assert await raw(operations.address, b"GET /healthz HTTP/1.1\r\nX: " + b"x" * 20_000) == b""
    assert await raw(operations.address, b"GET /healthz HTTP/1.1\r\n", close=True) == b""


async def test_a_slow_request_is_cut_off(operations, monkeypatch):
    monkeypatch.setattr("wonderland_chaincode.service.operations.REQUEST_S", 0.05)
    assert await raw(operations.address, b"GET /healthz") == b""


async def test_the_operations_port_is_said_when_it_is_taken(world, operations):
    with pytest.raises(SettingsError, match="metrics: cannot listen at"):
        await Operations(world.server).start(operations.address)


def record(message, *args, **extra):
    made = logging.LogRecord("wonderland_chaincode.service", logging.ERROR, __file__, 1, message, args, None)
    for name, value in extra.items():
        setattr(made, name, value)
    return made


def test_a_line_of_the_log_is_one_json_object():
    made = record("transaction %s failed\nhard", "ab", tx_id="ab", reference="01")
    try:
        int("é\n")
    except ValueError:
        made.exc_info = sys.exc_info()
    line = JsonLines().format(made)
    assert "\n" not in line
    document = json.loads(line)
    assert document["message"] == "transaction ab failed\nhard"
    assert (document["level"], document["logger"]) == ("error", "wonderland_chaincode.service")
    assert (document["tx_id"], document["reference"]) == ("ab", "01")
    assert "ValueError" in document["exception"]
    assert document["time"].endswith("+00:00")


async def test_no_client_writes_lines_into_the_log(tools, world, caplog):
    """The function's name and all that a peer quotes are the client's words."""
    await (await world.peer()).run(tools.Call("nowhere\n2026-01-01 CRITICAL forged"))
    texts = [each.getMessage() for each in caplog.records if "nowhere" in each.getMessage()]
    assert texts
    assert not any("\n" in text for text in texts)
