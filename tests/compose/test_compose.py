"""compose.yaml: made from the description, hardened, what the specification allows; and run, service by service."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest
import yaml
from kit.monitoring_names import names

from wonderland_fabric_network import binaries
from wonderland_fabric_network.compose import BFT, EMBEDDED, IMAGES, RAFT, compose, compose_yaml
from wonderland_fabric_network.description import NetworkDescription, Organisation

ROOT = Path(__file__).parents[2]
FILE = ROOT / "compose.yaml"
HERE = Path(__file__).parent
SCHEMA_VARIABLE = "COMPOSE_SPEC_SCHEMA"
NAMESPACES = ["unshare", "--mount", "--net", "--pid", "--fork", "--kill-child", "--mount-proc"]


@pytest.fixture(scope="module")
def document():
    return yaml.safe_load(FILE.read_text())


@pytest.fixture(scope="module")
def services(document):
    return document["services"]


def _named(profile, services):
    return {name: each for name, each in services.items() if not each.get("profiles") or profile in each["profiles"]}


def test_the_file_is_made_from_the_description():
    made = compose_yaml(NetworkDescription.load(ROOT / "deploy" / "network.yaml"))
    assert FILE.read_bytes() == made, "run `make compose`"


def test_it_meets_the_specifications_schema(document):
    """The schema is the Compose project's; it is not kept here. compose-spec/schema/compose-spec.json"""
    given = os.environ.get(SCHEMA_VARIABLE)
    if not given:
        pytest.skip(f"{SCHEMA_VARIABLE} does not name a copy of compose-spec.json")
    schema = json.loads(Path(given).read_text())
    schema["$schema"] = "http://json-schema.org/draft-07/schema#"
    jsonschema.Draft7Validator(schema).validate(document)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft7Validator(schema).validate({**document, "services": {"x": {"imag": "y"}}})


def test_no_service_has_more_than_it_needs(services):
    for name, each in services.items():
        assert each["user"].partition(":")[0] not in {"", "0", "root"}, name
        assert each["read_only"] is True, name
        assert each["cap_drop"] == ["ALL"], name
        assert each["security_opt"] == ["no-new-privileges:true"], name
        assert "privileged" not in each, name
        assert set(each["deploy"]["resources"]["limits"]) == {"cpus", "memory", "pids"}, name
        assert each["logging"]["options"] == {"max-size": "10m", "max-file": "3"}, name
        assert each["restart"] == "no" or "healthcheck" in each, name
        assert not any(mount["type"] != "volume" for mount in each["volumes"]), name


def test_only_the_console_is_published_and_only_here(document, services):
    published = {name: each["ports"] for name, each in services.items() if "ports" in each}
    (port,) = published.pop("backend")
    assert published == {}
    assert port["host_ip"] == "127.0.0.1"
    internal = {name for name, each in document["networks"].items() if each.get("internal")}
    for name, each in services.items():
        assert name == "backend" or set(each.get("networks", ())) <= internal, name


def test_images_are_pinned_and_no_secret_stands_in_the_file(services):
    assert {each["image"] for each in services.values()} == set(IMAGES.values())
    assert not any(each["image"].endswith(":latest") or ":" not in each["image"] for each in services.values())
    assert "PRIVATE KEY" not in FILE.read_text()
    for each in services.values():
        assert not {name for name in each.get("environment", {}) if name.endswith(("PASSWORD", "SECRET", "TOKEN"))}


def test_a_server_sees_its_own_directory_only(services):
    for name, each in services.items():
        if name.startswith(("ca.", "peer", "orderer", "contract-")):
            (mount,) = each["volumes"]
            msp_id = name.partition(".")[2]
            assert mount["volume"]["subpath"].lower().startswith(f"organisations/{msp_id}/"), name
            assert mount["target"] == f"/network/{mount['volume']['subpath']}", name


def test_every_profile_is_complete(document, services):
    """What is waited for without `required: false` is in the same profile, and so is whoever makes it."""
    for profile in (RAFT, BFT, EMBEDDED):
        chosen = _named(profile, services)
        for name, each in chosen.items():
            for other, wait in each.get("depends_on", {}).items():
                assert other in chosen or wait.get("required") is False, (profile, name, other)
            assert set(each.get("networks", ())) <= set(document["networks"])
            assert {mount["source"] for mount in each["volumes"]} <= set(document["volumes"])
    kinds = {profile: sum(name.startswith("orderer") for name in _named(profile, services)) for profile in (RAFT, BFT)}
    assert kinds == {RAFT: 3, BFT: 4}
    assert not any(name.startswith(("peer", "ca.")) for name in _named(EMBEDDED, services))


def test_the_default_profile_is_named():
    assert f"COMPOSE_PROFILES={RAFT}\n" in (ROOT / ".env").read_text()


def test_another_description_gives_other_services():
    described = NetworkDescription(channel="helsinki").with_organisation(
        Organisation(msp_id="HarbourMSP", kind="pads", peers=2)
    )
    made = compose(described)
    assert {"ca.harbourmsp", "peer0.harbourmsp", "peer1.harbourmsp"} <= set(made["services"])
    described_inside = NetworkDescription.from_yaml(made["configs"]["network-raft"]["content"].encode())
    assert (described_inside.channel, described_inside.hosts) == ("helsinki", "each")


def _needs_namespaces():
    if os.geteuid() != 0 or not all(map(shutil.which, ("unshare", "nsenter", "setpriv", "ip"))):
        pytest.skip("running compose.yaml's services needs root, util-linux and iproute2")
    if subprocess.run([*NAMESPACES, "true"], capture_output=True, check=False).returncode:
        pytest.skip("this machine allows no namespaces")
    if not sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb")):
        pytest.skip("PostgreSQL's server programs are needed")


def _run(profile, work, times=1):
    command = [*NAMESPACES, sys.executable, str(HERE / "run_profile.py"), str(FILE), profile, str(work), str(times)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=570, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def _check(found, ledger):
    for run in found["runs"]:
        assert run["anonymous"] == 403  # nobody is let in before the first administrator has set it up
        assert run["ledger"] == ledger
        assert (run["verdict"]["outcome"], run["verdict"]["permission"]) == ("verified", "granted")
        for name, mib in run["mib"].items():
            limit = found["limits"][name]
            assert 2 * mib < int(limit[:-1]) * (1024 if limit.endswith("G") else 1), (name, mib, limit)
    for codes in found["codes"]:
        # A CA of Fabric has no way to end but the signal.
        assert {code for name, code in codes.items() if not name.startswith("ca.")} == {0}


@pytest.mark.postgres
@pytest.mark.timeout(600)
def test_the_embedded_profile_permits_a_landing(tmp_path):
    _needs_namespaces()
    _check(_run(EMBEDDED, tmp_path), "embedded")


@pytest.mark.fabric
@pytest.mark.postgres
@pytest.mark.timeout(600)
def test_the_raft_profile_permits_a_landing(tmp_path):
    _needs_namespaces()
    _needs_fabric()
    found = _run(RAFT, tmp_path)
    _check(found, "fabric")
    there = {name for each in found["runs"][0]["metrics"].values() for name in each}
    # Of the other consensus, and from a command that an operator runs.
    elsewhere = {name for name in names() if name.startswith(("consensus_BFT_", "wonderland_network_"))}
    assert {name: where for name, where in names().items() if name not in there | elsewhere} == {}


def _needs_fabric():
    try:
        servers = binaries.find_binaries()
    except binaries.BinaryError as error:
        pytest.skip(f"Fabric's servers are needed: {error}")
    os.environ.setdefault("FABRIC_BIN", str(servers["peer"].parent))
