"""The package that organisations agree on, and the builder by which peers find the contract's server."""

import gzip
import io
import json
import os
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

from wonderland_fabric_network import builder
from wonderland_fabric_network.contract import InstalledContract, build_package, installed_contract, source_digest
from wonderland_fabric_network.settings import BUILDER_VARIABLE, builder_configuration

CONTRACT = InstalledContract("pol", "1.0", "ab" * 32)


def _files(data):
    with tarfile.open(fileobj=io.BytesIO(data), mode="r:gz") as tar:
        return {entry.name: tar.extractfile(entry).read() for entry in tar.getmembers()}


def test_equal_contracts_give_equal_packages_at_any_time():
    first, second = build_package("pol", CONTRACT, "a"), build_package("pol", CONTRACT, "a")
    assert first.data == second.data
    assert first.package_id == second.package_id
    assert first.package_id.startswith("pol_1.0:")


def test_another_source_another_slot_another_package():
    other = InstalledContract("pol", "1.0", "cd" * 32)
    ids = {build_package("pol", each, slot).package_id for each in (CONTRACT, other) for slot in ("a", "b")}
    assert len(ids) == 4


def test_what_is_in_it():
    package = build_package("pol", CONTRACT, "b")
    assert gzip.decompress(package.data)[257:262] == b"ustar"
    files = _files(package.data)
    assert json.loads(files["metadata.json"]) == {"label": "pol_1.0", "path": "", "type": "ccaas"}
    code = _files(files["code.tar.gz"])
    connection = json.loads(code["connection.json"])
    assert connection["address"] == "{{.address_b}}"
    assert connection["tls_required"] is True
    assert connection["client_auth_required"] is True
    assert json.loads(code["contract.json"]) == {"contract": "pol", "sha256": "ab" * 32, "version": "1.0"}


def test_the_digest_is_of_every_source_file(tmp_path, monkeypatch):
    package = tmp_path / "some_contract"
    (package / "inner").mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "inner" / "rules.py").write_text("LIMIT = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    first = source_digest(["some_contract"])
    assert source_digest(["some_contract"]) == first
    (package / "inner" / "rules.py").write_text("LIMIT = 2\n")
    second = source_digest(["some_contract"])
    (package / "inner" / "rules.py").rename(package / "inner" / "rulez.py")
    assert len({first, second, source_digest(["some_contract"])}) == 3


def test_the_installed_contract_has_version_and_digest():
    found = installed_contract("pol")
    assert found.version
    assert len(found.sha256) == 64


@pytest.fixture
def script(tmp_path):
    """Runs the builder as the peer does: a program of its own, with little environment."""

    def run(command, *places, values=None):
        environment = {"PATH": os.environ["PATH"]}
        if values is not None:
            environment[BUILDER_VARIABLE] = values
        arguments = [sys.executable, "-I", "-S", Path(builder.__file__), command, *places]
        return subprocess.run(arguments, env=environment, capture_output=True, text=True, timeout=20, check=False)

    return run


@pytest.fixture
def unpacked(tmp_path):
    files = _files(build_package("pol", CONTRACT, "a").data)
    (tmp_path / "metadata").mkdir()
    (tmp_path / "metadata" / "metadata.json").write_bytes(files["metadata.json"])
    (tmp_path / "source").mkdir()
    for name, data in _files(files["code.tar.gz"]).items():
        (tmp_path / "source" / name).write_bytes(data)
    for name in ("output", "release"):
        (tmp_path / name).mkdir()
    return tmp_path


def test_a_package_goes_through_the_builder(script, unpacked):
    source, metadata, output, release = (unpacked / name for name in ("source", "metadata", "output", "release"))
    (source / "META-INF" / "statedb").mkdir(parents=True)
    (source / "META-INF" / "statedb" / "index.json").write_text("{}")
    values = builder_configuration(["pad:1", "pad:2"], b"-- cert\n--", b'-- "key"\n--', b"-- root\n--")
    assert script("detect", source, metadata).returncode == 0
    assert script("build", source, metadata, output, values=values).returncode == 0
    assert script("release", output, release).returncode == 0
    connection = json.loads((release / "chaincode" / "server" / "connection.json").read_text())
    assert connection == {
        "address": "pad:1",
        "dial_timeout": "10s",
        "tls_required": True,
        "client_auth_required": True,
        "client_cert": "-- cert\n--",
        "client_key": '-- "key"\n--',
        "root_cert": "-- root\n--",
    }
    assert (release / "chaincode" / "server" / "connection.json").stat().st_mode & 0o077 == 0
    assert (release / "statedb" / "index.json").read_text() == "{}"


def test_another_kind_of_package_is_left_to_others(script, unpacked):
    (unpacked / "metadata" / "metadata.json").write_text('{"type": "golang"}')
    assert script("detect", unpacked / "source", unpacked / "metadata").returncode == 1


@pytest.mark.parametrize(
    ("command", "values", "says"),
    [
        ("build", "{}", "has no 'address_a'"),
        ("build", "[1", "contract builder: "),
        ("detecct", "{}", "is none of detect, build, release"),
    ],
)
def test_what_is_wrong_is_in_the_peers_log(script, unpacked, command, values, says):
    result = script(command, unpacked / "source", unpacked / "metadata", unpacked / "output", values=values)
    assert result.returncode == 1
    assert says in result.stderr
    assert "Traceback" not in result.stderr


def test_the_builder_needs_the_right_number_of_places(script, unpacked):
    result = script("build", unpacked / "source")
    assert (result.returncode, "Traceback" in result.stderr) == (1, False)
