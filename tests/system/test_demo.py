from __future__ import annotations

import re
import signal
import subprocess
import sys
import time

import httpx
import pytest

HONEST = {"OH-DRN-0233", "OH-DRN-0377", "OH-DRN-0118", "OH-DRN-0102", "OH-DRN-0281"}
IMPERSONATED = "OH-DRN-0281"
EXPECTED = {
    "OH-DRN-0417": ("refuted", "outside_buffer"),
    "OH-DRN-0640": ("inconclusive", "broadcast_unsupported"),
    "OH-DRN-0871": ("inconclusive", "codes_not_matched"),
    "OH-DRN-0925": ("unauthorised", "maintenance_lapsed"),
}


TIMED = "OH-DRN-0559"
"""It sets out late; its ranges fit its claim, its frames' time stamps do not."""
MIXED = "OH-DRN-0736"
"""It sets out last; two of five of its signed claims are false."""
LATE = {TIMED, MIXED}
TORN = {"claims_torn", "claims_unseen", "claims_waver", "no_estimate"}


def judge(lines):
    """Honest drones verified and permitted, each liar not, for the reason that fits."""
    by_drone = {line["drone"]: line for line in lines}
    assert set(by_drone) == HONEST | set(EXPECTED)
    for drone in HONEST:
        line = by_drone[drone]
        assert (line["outcome"], line["permission"]) == ("verified", "granted"), line
        assert line["likelihood"] >= 0.99
        assert line["error_m"] < 1.0
        assert len(line["transaction"]) == 64
        assert {"poll", "range", "confirm", "verdict"} <= set(line["steps_ms"])
    for drone, (outcome, reason) in EXPECTED.items():
        line = by_drone[drone]
        assert (line["outcome"], line["permission"]) == (outcome, "refused"), line
        assert reason in line["reasons"]
    assert by_drone["OH-DRN-0417"]["error_m"] == pytest.approx(4.2, abs=0.5)
    assert by_drone["OH-DRN-0640"]["broadcast_error_m"] == pytest.approx(30.4, abs=1.5)
    assert by_drone["OH-DRN-0640"]["likelihood"] >= 0.99
    assert {line["broadcast"] for line in lines if line["drone"] in HONEST - {IMPERSONATED}} == {"supported"}
    impersonated = by_drone[IMPERSONATED]
    assert impersonated["broadcast"] == "contradicted"
    assert impersonated["broadcast_error_m"] == pytest.approx(36.1, abs=0.5)
    assert "broadcast_contradicts" in impersonated["reasons"]


@pytest.mark.timeout(240)
def test_honest_drones_are_verified_and_each_liar_not(wonderland):
    code, lines, errors = wonderland("demo", "--headless", "--json", "--until", "14", timeout_s=200)
    assert code == 0, errors
    first = {line["drone"]: line for line in reversed(lines)}
    timed, mixed = first.pop(TIMED), first.pop(MIXED)
    judge(list(first.values()))
    assert (mixed["outcome"], mixed["permission"]) == ("inconclusive", "refused"), mixed
    assert TORN & set(mixed["reasons"])
    assert (timed["outcome"], timed["permission"]) == ("refuted", "refused"), timed
    assert "time_differences_contradict" in timed["reasons"]
    assert first["OH-DRN-0102"]["assurance"] == 3
    assert "no multi-party trust" in " ".join(errors.split())


@pytest.mark.fabric
@pytest.mark.timeout(300)
def test_the_same_demo_on_a_real_fabric_network(wonderland, fabric_servers):
    code, lines, errors = wonderland(
        "demo", "--ledger", "fabric", "--headless", "--json", "--until", "11", timeout_s=240
    )
    assert code == 0, errors
    assert len(lines) == 11
    judge([line for line in lines if line["drone"] not in LATE])
    assert "no multi-party trust" not in " ".join(errors.split())


@pytest.mark.timeout(150)
def test_two_demos_side_by_side_each_with_a_link_that_works_once_and_ctrl_c_ends_both(environment):
    command = [sys.executable, "-m", "wonderland.cli", "demo"]
    demos = [
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment)
        for _ in range(2)
    ]
    try:
        links = []
        for demo in demos:
            for line in demo.stdout:
                if match := re.search(r"(http://127\.0\.0\.1:\d+)/#token=(\S+)", line):
                    links.append(match.groups())
                    break
        assert len({base for base, _ in links}) == 2
        for base, token in links:
            with httpx.Client(base_url=base, timeout=10) as client:
                assert client.get("/").status_code == 200
                assert client.get("/api/v1/pads").status_code == 401
                assert client.post("/api/v1/session", json={"token": token}).status_code < 300
                pads = wait_for(lambda client=client: client.get("/api/v1/pads").json()["items"], 3)
                assert {pad["status"] for pad in pads} == {"commissioned"}
                status = client.get("/api/v1/status").json()
                assert status["ledger"]["kind"] == "embedded"
                assert "no multi-party trust" in status["ledger"]["notice"]
            with httpx.Client(base_url=base, timeout=10) as other:
                assert other.post("/api/v1/session", json={"token": token}).status_code in {401, 403}
    finally:
        for demo in demos:
            demo.send_signal(signal.SIGINT)
        codes = [demo.wait(timeout=30) for demo in demos]
        for demo in demos:
            demo.stdout.close()
    assert codes == [0, 0]


def wait_for(ask, count, limit_s: float = 30.0):
    """What ``ask`` returns once it has so many items: the mirror is a moment behind the ledger."""
    deadline = time.monotonic() + limit_s
    while True:
        found = ask()
        if len(found) >= count or time.monotonic() > deadline:
            return found
        time.sleep(0.1)
