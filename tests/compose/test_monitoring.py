"""What is shipped for Prometheus and Grafana fits what is shipped to run."""

import datetime as dt
import json
from pathlib import Path

import pytest
import yaml
from kit.monitoring_names import DIRECTORY, expressions, names

from wonderland_edge_agent.metrics import exposition, write_metrics
from wonderland_fabric_network.ports import USUAL
from wonderland_fabric_network.status import CertificateStatus, ComponentStatus, NetworkStatus

COMPOSE = Path(__file__).parents[2] / "compose.yaml"


def test_names_are_found_in_expressions():
    found = names()
    assert {"ledger_blockchain_height", "wonderland_pad_anchor_up", "consensus_BFT_is_leader"} <= set(found)
    assert not {"job", "pad_id", "histogram_quantile", "rate", "instance", "le", "time"} & set(found)
    assert len(list(expressions())) > 40


def test_every_server_of_the_raft_profile_is_scraped():
    scraped = {
        target
        for job in yaml.safe_load((DIRECTORY / "prometheus.yml").read_text())["scrape_configs"]
        for group in job["static_configs"]
        for target in group["targets"]
    }
    services = yaml.safe_load(COMPOSE.read_text())["services"]
    wanted = {
        f"{name}:{USUAL['peer']['operations']}"
        for name, each in services.items()
        if "." in name and "raft" in each["profiles"]
    }
    assert scraped == wanted | {"backend:8080"}


def test_every_alert_says_what_to_do():
    for group in yaml.safe_load((DIRECTORY / "alerts.yml").read_text())["groups"]:
        for rule in group["rules"]:
            assert rule["labels"]["severity"] in {"warning", "critical"}
            assert set(rule["annotations"]) == {"summary", "action"}


def test_the_dashboards_panels_do_not_overlap():
    taken = set()
    for panel in json.loads((DIRECTORY / "grafana-dashboard.json").read_text())["panels"]:
        place = panel["gridPos"]
        cells = {
            (x, y)
            for x in range(place["x"], place["x"] + place["w"])
            for y in range(place["y"], place["y"] + place["h"])
        }
        assert not cells & taken, panel["title"]
        assert place["x"] + place["w"] <= 24
        taken |= cells


STATUS = {
    "pad_id": 'roof "7"\\',
    "version": "0.1.0",
    "t_ms": 1_500,
    "accepts_sessions": False,
    "session": "",
    "sessions_run": 3,
    "requests_waiting": 0,
    "sessions_to_end": 1,
    "prekeys": 20,
    "spool": {"records": 4, "bytes": 512, "dropped": 0},
    "receiver": {"frames": 9, "bad": 2},
    "anchors": [{"anchor_id": "A1", "state": "up"}, {"anchor_id": "A2", "state": "silent"}],
}


def test_a_pads_metrics(tmp_path):
    write_metrics(tmp_path / "pad.prom", STATUS)
    text = (tmp_path / "pad.prom").read_text()
    label = r'pad_id="roof \"7\"\\"'
    for line in (
        f"wonderland_pad_status_timestamp_seconds{{{label}}} 1.5",
        f"wonderland_pad_accepts_sessions{{{label}}} 0",
        f'wonderland_pad_anchor_up{{{label},anchor_id="A1"}} 1',
        f'wonderland_pad_anchor_up{{{label},anchor_id="A2"}} 0',
        f"wonderland_pad_remote_id_bad_total{{{label}}} 2",
    ):
        assert f"\n{line}\n" in text
    assert text.count("# TYPE ") == text.count("# HELP ") == 15


def test_a_networks_metrics():
    status = NetworkStatus(
        "c",
        "raft",
        elsewhere=False,
        components=(ComponentStatus("PadMSP.ca", "ca", 7), ComponentStatus("PadMSP.peer0", "peer", None)),
        certificates=(CertificateStatus("PadMSP/peer0", "x", "2026-06-01T00:00:00Z", 1),),
    )
    text = status.exposition().decode()
    assert 'wonderland_network_component_up{component="PadMSP.ca",kind="ca"} 1\n' in text
    assert 'wonderland_network_component_up{component="PadMSP.peer0",kind="peer"} 0\n' in text
    end = dt.datetime(2026, 6, 1, tzinfo=dt.UTC).timestamp()
    assert f'certificate_expiry_timestamp_seconds{{owner="PadMSP/peer0"}} {end:.0f}\n' in text


@pytest.mark.parametrize("prefix", ["wonderland_pad_", "wonderland_network_"])
def test_what_is_asked_of_files_is_in_them(prefix):
    status = NetworkStatus(
        "c",
        "raft",
        elsewhere=False,
        components=(),
        certificates=(CertificateStatus("a", "x", "2026-06-01T00:00:00Z", 1),),
    )
    written = exposition(STATUS).decode() + status.exposition().decode()
    assert {name for name in names() if name.startswith(prefix) and f"\n{name}{{" not in written} == set()
