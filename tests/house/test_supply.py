"""What people install is listed, made the same way twice, and has no secret in it."""

from __future__ import annotations

import json
import os
import re
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from detect_secrets.core.scan import scan_file
from detect_secrets.settings import transient_settings
from kit.backend_process import ledger, ready, start, stop
from kit.packages import build_wheels

ROOT = Path(__file__).resolve().parents[2]
PYTHON, CONSOLE = "wonderland-python.cdx.json", "wonderland-console.cdx.json"
LOCKED = re.compile(r"^([a-z0-9][\w.-]*)==([^\s;\\]+)", re.MULTILINE | re.IGNORECASE)
__all__ = ["ledger"]

# What finds real secrets; guessing by entropy finds every hash of ours.
DETECTORS = [
    *("AWSKeyDetector", "AzureStorageKeyDetector", "BasicAuthDetector", "DiscordBotTokenDetector"),
    *("GitHubTokenDetector", "GitLabTokenDetector", "JwtTokenDetector", "MailchimpDetector", "NpmDetector"),
    *("OpenAIDetector", "PrivateKeyDetector", "PypiTokenDetector", "SendGridDetector", "SlackDetector"),
    *("StripeDetector", "TelegramBotTokenDetector", "TwilioKeyDetector"),
]


@pytest.fixture(scope="module")
def boms(tmp_path_factory):
    first, second = tmp_path_factory.mktemp("first"), tmp_path_factory.mktemp("second")
    for directory in (first, second):
        command = [sys.executable, str(ROOT / "scripts" / "supply.py"), "sbom", str(directory)]
        subprocess.run(command, check=True, capture_output=True, timeout=110)
    for name in (PYTHON, CONSOLE):
        assert (first / name).read_bytes() == (second / name).read_bytes(), "made the same way twice"
    return {name: (first / name).read_text() for name in (PYTHON, CONSOLE)}


def test_all_that_is_installed_is_listed_with_its_hashes(boms):
    listed = {each["name"]: each for each in json.loads(boms[PYTHON])["components"]}
    assert {name: each["version"] for name, each in listed.items()} == dict(
        LOCKED.findall((ROOT / "requirements" / "run.txt").read_text())
    )
    assert {"fastapi", "cryptography", "numpy", "grpcio"} <= listed.keys()
    for name, each in listed.items():
        assert each["purl"] == f"pkg:pypi/{name}@{each['version']}"
        hashes = [one for reference in each["externalReferences"] for one in reference.get("hashes", [])]
        assert any(one["alg"] == "SHA-256" for one in hashes), name


def test_what_the_browser_gets_is_listed(boms):
    listed = {each["name"]: each for each in json.loads(boms[CONSOLE])["components"]}
    manifest = json.loads((ROOT / "frontend" / "package.json").read_text())
    assert set(manifest["dependencies"]) <= listed.keys()
    assert not {"vite", "vitest", "eslint", "typescript"} & listed.keys(), "tools do not get to the browser"
    assert all(each["purl"].endswith(f"@{each['version']}") for each in listed.values())


@pytest.mark.parametrize(("which", "version"), [(PYTHON, SchemaVersion.V1_6), (CONSOLE, SchemaVersion.V1_5)])
def test_the_lists_are_cyclonedx(boms, which, version):
    problem = JsonStrictValidator(version).validate_str(boms[which])
    assert problem is None, problem


def test_a_wheel_is_made_the_same_way_twice(tmp_path):
    project = ROOT / "libraries" / "remote_id"
    made = []
    for name, t_s in (("one", 1_700_000_000), ("two", 1_800_000_000)):
        copy = tmp_path / name
        shutil.copytree(project, copy, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
        for path in copy.rglob("*"):
            os.utime(path, (t_s, t_s))
        (wheel,) = build_wheels([copy], tmp_path / f"{name}-wheels")
        made.append(wheel.read_bytes())
    assert made[0] == made[1]


MADE_UP = {
    "backend/wonderland_backend/reference/examples.py": "a token in the API's examples",
    "frontend/src/shared/signing/vectors.json": "keys of test vectors",
    "tests/api/test_tokens.py": "tokens and a key that tests refuse",
    "tests/api/test_webhooks.py": "an address with a password that is refused",
    "tests/edge_spool/test_uplink.py": "an address with a password that is refused",
    "tests/ledger_client/test_signing.py": "a key that cannot be read",
    "tests/people/test_pages.py": "a token that a page must not show",
}
"""What looks like a secret and is none."""


LOOKS_LIKE = re.compile(
    rb"PRIVATE KEY|eyJ|gh[opsur]_|A[KS]IA|xox|[rs]k[-_]|glpat|pypi-|npm_|SG\.|AccountKey|AC[0-9a-f]{32}|-us\d"
    rb"|\d{8,10}:|[MNO][\w-]{23}\.|://[^/\s]{1,80}:[^/\s]{1,80}@"
)
"""What some detector may find something in: they take half a minute for all files."""


def findings(paths):
    paths = [path for path in paths if LOOKS_LIKE.search(path.read_bytes())]
    with transient_settings({"plugins_used": [{"name": name} for name in DETECTORS]}):
        return [f"{each.filename}:{each.line_number}: {each.type}" for path in paths for each in scan_file(str(path))]


def is_kept_by_a_server(path):
    """Keys of webhooks have no form that a detector could know, and databases are no text."""
    return path.suffix in {".key", ".db", ".sqlite3", ".p12", ".pfx"}


def test_no_secret_is_committed():
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False, text=True)
    if listed.returncode:
        pytest.skip("no git checkout: which files are committed is not known")
    paths = [ROOT / name for name in listed.stdout.split("\0") if name]
    found = findings(path for path in paths if path.is_file())
    assert [path.name for path in paths if is_kept_by_a_server(path)] == []
    where = {line.removeprefix(f"{ROOT}/").partition(":")[0] for line in found}
    assert where - MADE_UP.keys() == set(), found
    assert MADE_UP.keys() - where == set(), "these are no longer there: take them off the list"


def test_a_secret_would_be_found(tmp_path):
    assert is_kept_by_a_server(tmp_path / "wonderland.db.webhooks.key")
    for name, text in {
        "key": "-----BEGIN EC " + "PRIVATE KEY-----\nMHcCAQEE\n",
        "token": "ghp_" + "A1b2" * 9,
        "url": "postgresql://wonderland:" + "hunter2hunter2" + "@db.example/w",
    }.items():
        (tmp_path / name).write_text(f"value = {text!r}\n" if name != "key" else text)
        assert findings([tmp_path / name]), name


async def test_what_has_a_secret_is_its_owners_alone(ledger, tmp_path):
    """A ledger, its CAs and a backend, made with the umask that most machines have."""
    before = os.umask(0o022)
    try:
        process = await start(tmp_path, database=f"sqlite:///{tmp_path}/wonderland.db")
        try:
            await ready(process)
            secret = [path for path in tmp_path.rglob("*") if path.is_file() and _has_secret(path)]
            assert len(secret) > 5
            open_to_others = [str(path.relative_to(tmp_path)) for path in secret if _is_open(path, tmp_path)]
        finally:
            await stop(process)
    finally:
        os.umask(before)
    assert open_to_others == []


def _is_open(path, above):
    """Whether others get at a file: its own mode, and those of the directories below `above`."""
    return all(stat.S_IMODE(each.stat().st_mode) & 0o077 for each in (path, *path.parents) if above in each.parents)


def _has_secret(path):
    data = path.read_bytes()
    return b"PRIVATE KEY" in data or path.suffix in {".key", ".db", ".sqlite3"} or b"SQLite format 3" in data[:16]
