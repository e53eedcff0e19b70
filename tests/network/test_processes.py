"""Processes that outlive the command which started them."""

import asyncio
import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from wonderland_fabric_network.errors import ComponentError
from wonderland_fabric_network.processes import Launch, ProcessTable

SERVER = """
import signal, socket, sys, time
if "stubborn" in sys.argv: signal.signal(signal.SIGTERM, signal.SIG_IGN)
s = socket.socket(); s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
s.bind(("127.0.0.1", int(sys.argv[1]))); s.listen(); print("serving", flush=True)
time.sleep(600)
"""


def _free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def table(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "logs").mkdir()
    table = ProcessTable(tmp_path / "run", tmp_path / "logs")
    yield table
    for name in table.names():
        if (pid := table.pid(name)) is not None:
            os.kill(pid, signal.SIGKILL)


def _server(name="server", *words):
    port = _free_port()
    return Launch(name, (sys.executable, "-c", SERVER, str(port), *words), {}, (("127.0.0.1", port),))


async def test_a_process_starts_is_found_again_and_stops(table):
    launch = _server()
    pid = table.start(launch)
    await table.wait_ready(launch)
    assert table.pid("server") == pid
    assert ProcessTable(table._run, table._logs).pid("server") == pid
    assert table.names() == ("server",)
    assert table.tail("server") == "serving"
    assert await table.stop("server")
    assert table.pid("server") is None
    assert not await table.stop("server")


async def test_it_runs_once(table):
    launch = _server()
    table.start(launch)
    with pytest.raises(ComponentError, match="runs already"):
        table.start(launch)


async def test_it_starts_again_after_a_crash(table):
    launch = _server()
    pid = table.start(launch)
    await table.wait_ready(launch)
    os.kill(pid, signal.SIGKILL)
    while table.pid("server") is not None:
        await asyncio.sleep(0.01)
    assert table.start(launch) != pid
    await table.wait_ready(launch)


async def test_one_that_does_not_listen_to_reason_is_killed(table):
    launch = _server("stubborn", "stubborn")
    table.start(launch)
    await table.wait_ready(launch)
    assert await table.stop("stubborn", patience_s=0.2)
    assert table.pid("stubborn") is None


async def test_it_outlives_the_process_that_started_it(table, tmp_path):
    launch = _server()
    script = (
        "from pathlib import Path\n"
        "from wonderland_fabric_network.processes import *\n"
        f"t = ProcessTable(Path({str(table._run)!r}), Path({str(table._logs)!r}))\n"
        f"print(t.start(Launch('server', {launch.arguments!r})))\n"
    )
    out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=30)
    await table.wait_ready(launch)
    assert table.pid("server") == int(out.stdout)
    assert await table.stop("server")


async def test_an_id_that_somebody_else_has_now_is_not_taken_for_ours(table):
    (table._run / "server").write_text(f"{os.getpid()}\n")
    assert table.pid("server") is None
    assert not await table.stop("server")


async def test_one_that_ends_at_once_is_reported_with_its_last_words(table):
    launch = Launch(
        "broken",
        (sys.executable, "-c", "import sys; sys.exit('bind: address already in use')"),
        {},
        (("127.0.0.1", _free_port()),),
    )
    table.start(launch)
    with pytest.raises(ComponentError) as raised:
        await table.wait_ready(launch)
    assert raised.value.component == "broken"
    assert "ended while it was starting" in str(raised.value)
    assert "bind: address already in use" in raised.value.log_tail
    assert "another program has its port" in raised.value.remedy


async def test_a_program_that_is_not_there_is_reported(table):
    launch = Launch("none", ("/nowhere/peer",), {}, (("127.0.0.1", _free_port()),))
    table.start(launch)
    with pytest.raises(ComponentError, match="ended while it was starting"):
        await table.wait_ready(launch)


async def test_one_that_never_listens_is_reported(table):
    launch = Launch("deaf", (sys.executable, "-c", "import time; time.sleep(60)"), {}, (("127.0.0.1", _free_port()),))
    table.start(launch)
    with pytest.raises(ComponentError, match="did not listen"):
        await table.wait_ready(launch, timeout_s=0.3)


@pytest.mark.parametrize(
    ("last_words", "remedy"),
    [
        ("panic: write: no space left on device", "make room"),
        ("open x: permission denied", "another user"),
        ("x509: certificate has expired or is not yet valid", "network renew"),
        ("accept: too many open files", "ulimit"),
        ("something else", "see "),
    ],
)
def test_the_log_tells_the_remedy(table, last_words, remedy):
    table.log("peer").write_text(last_words)
    assert remedy in table.failure("peer", "ended").remedy


def test_a_log_of_any_size_and_content_has_an_end(table):
    table.log("peer").write_bytes(b"x" * 100_000 + b"\n\xff\xfe\n" + b"last\n")
    assert table.tail("peer", 1) == "last"
    assert table.tail("nobody") == ""


def test_looking_disturbs_nobody(table):
    launch = _server()
    deadline = time.monotonic() + 1
    while time.monotonic() < deadline and table.pid("server") is None:
        table.start(launch)
    assert table.pid("server") is not None


async def test_logs_are_put_aside_while_the_process_writes_on(table):
    script = "import sys, time\nwhile True: print('x' * 99, flush=True); time.sleep(0.001)"
    table.start(Launch("writer", (sys.executable, "-c", script)))
    log = table.log("writer")
    while not log.exists() or log.stat().st_size < 10_000:
        await asyncio.sleep(0.01)
    assert table.shorten_logs(limit=100 << 20) == []
    assert table.shorten_logs(limit=5_000) == ["writer"]
    aside = log.with_name("writer.log.1")
    assert aside.stat().st_size >= 10_000
    assert aside.stat().st_mode & 0o077 == 0
    while log.stat().st_size == 0:
        await asyncio.sleep(0.01)
    assert log.read_bytes()[:5] == b"xxxxx"  # no hole where the former lines were


async def test_only_the_last_run_counts_for_the_remedy(table):
    table.log("broken").write_text("panic: no space left on device\n")
    launch = Launch("broken", (sys.executable, "-c", "import sys; sys.exit('bind: address already in use')"))
    table.start(launch)
    while table.pid("broken") is not None:
        await asyncio.sleep(0.01)
    assert "another program has its port" in table.failure("broken", "ended").remedy


def test_a_go_programs_stacks_are_left_out(table):
    stack = "".join(f"main.f{number}()\n\t/src/f.go:{number}\n" for number in range(100))
    table.log("peer").write_text(
        f"2026 INFO starting\npanic: write db: no space left on device\n\ngoroutine 1:\n{stack}"
    )
    error = table.failure("peer", "ended")
    assert error.log_tail.splitlines()[-1] == "panic: write db: no space left on device"
    assert "make room" in error.remedy
