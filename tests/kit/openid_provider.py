"""A real OpenID provider (npm oidc-provider) on loopback: how to start it, and who has an account there."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).parents[1] / "people" / "provider"
SECRET = "a secret of tests, with : and %"
ACCOUNTS = {
    "ada": {"email": "ada@example.org", "email_verified": True, "name": "Ada", "groups": ["officers"]},
    "grace": {"email": "Grace@Example.org", "email_verified": True, "name": "Grace", "groups": ["guests", "officers"]},
    "mallory": {"email": "grace@example.org", "email_verified": False, "name": "Mallory"},
    "nobody": {"name": "Nobody"},
}


def _install():
    npm = shutil.which("npm")
    if npm is None or shutil.which("node") is None:
        pytest.skip("Node.js and npm are not installed; the OpenID provider cannot be run")
    wanted = hashlib.sha256((HERE / "package-lock.json").read_bytes()).hexdigest()
    stamp = HERE / "node_modules" / ".installed"
    if stamp.is_file() and stamp.read_text() == wanted:
        return
    try:
        command = [npm, "ci", "--ignore-scripts"]
        done = subprocess.run(command, cwd=HERE, capture_output=True, text=True, timeout=240, check=False)
    except subprocess.TimeoutExpired:
        pytest.skip("npm ci did not finish within 240 s; is there a registry?")
    if done.returncode:
        pytest.skip(f"npm ci could not install the OpenID provider: {done.stderr.strip()[-300:]}")
    stamp.write_text(wanted)


def command(redirect_uri):
    """What starts it; it says its issuer as a line of JSON."""
    _install()
    return ["node", str(HERE / "provider.mjs"), redirect_uri, json.dumps(ACCOUNTS)]
