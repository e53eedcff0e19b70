"""The Debian packages on a bare machine: installed, each does its main job, upgraded, and gone again.

One machine for all, in this order.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

pytestmark = pytest.mark.timeout(400)
VECTORS = Path(__file__).resolve().parents[1] / "vectors" / "evidence"
SERVICES = {"backend": "wonderland-backend", "pad": "wonderland", "uav": "wonderland"}
"""User by service."""
SERVED = """
set -e
cd /tmp
wonderland ledger start --json --listen 127.0.0.1:7051 --data /tmp/ledger >/tmp/ledger.json &
for i in $(seq 100); do [ -s /tmp/ledger.json ] && break; sleep 0.2; done
wonderland ledger ca enrol pad-1 --data /tmp/ledger --role pad >/dev/null
for each in backend:wonderland-backend pad:wonderland uav:wonderland; do
  user=${each#*:}; to=/etc/wonderland/${each%:*}
  rm -rf $to; cp -r /tmp/ledger $to; chown -R $user:$user $to
  sed -i "s,/tmp/ledger,$to,g" $to/connection.json
done
cd /var/lib/wonderland-backend
"$@" >/tmp/said 2>&1 &
/usr/lib/wonderland/bin/python3 - <<'END' || { cat /tmp/said; exit 1; }
import re, time, urllib.request
for _ in range(300):
    try:
        page = urllib.request.urlopen("http://127.0.0.1:8123/", timeout=5).read().decode()
        break
    except OSError:
        time.sleep(0.2)
(script,) = re.findall(r'<script type="module"[^>]* src="([^"]+)"', page)
print("script", len(urllib.request.urlopen("http://127.0.0.1:8123" + script, timeout=5).read()))
print("health", urllib.request.urlopen("http://127.0.0.1:8123/api/v1/health", timeout=5).read().decode())
END
cat /tmp/said
"""


@pytest.fixture(scope="module")
def installed(machine, packages):
    """The machine after `dpkg --install`, and what was there before."""
    before = machine.files()
    said = machine.run("sh", "-c", "umask 077; dpkg --install /tmp/wonderland*.deb", timeout_s=300)
    assert set(packages) == {"wonderland", *(f"wonderland-{each}" for each in SERVICES)}
    return machine, before, said


def exec_start(machine, service):
    """(user, command) of the unit that its package brought."""
    (unit,) = machine.root.glob(f"usr/lib/systemd/system/wonderland-{service}.service")
    text = unit.read_text()
    return re.findall(r"^User=(.*)$", text, re.MULTILINE)[0], re.findall(r"^ExecStart=(.*)$", text, re.MULTILINE)[0]


def by(machine, service, *more):
    """Its unit's command, as its unit's user."""
    user, command = exec_start(machine, service)
    return "setpriv", f"--reuid={user}", f"--regid={user}", "--init-groups", *command.split(), *more


def test_no_service_starts_before_somebody_configured_it(installed):
    machine, _, said = installed
    for service, user in SERVICES.items():
        assert f"wonderland-{service} is not started yet: nobody has configured it." in said
        assert exec_start(machine, service)[0] == user
        assert machine.run("stat", "-c", "%a %U %G", f"/etc/wonderland/{service}.toml").split() == ["640", "root", user]
        # What runs starts again after an upgrade, and is stopped before it is removed; there is no systemd here to do it.
        scripts = machine.root / "var/lib/dpkg/info"
        unit = f"wonderland-{service}.service"
        assert f"deb-systemd-invoke try-restart '{unit}'" in (scripts / f"wonderland-{service}.postinst").read_text()
        assert f"deb-systemd-invoke stop {unit}" in (scripts / f"wonderland-{service}.prerm").read_text()
    assert not list(machine.root.glob("etc/systemd/system/*.wants/wonderland*"))
    assert "pad.toml: pad_id is missing" in machine.run(*by(machine, "pad"), code=1)
    assert "Missing option '--connection'" in machine.run(*by(machine, "uav"), code=2)
    for user in set(SERVICES.values()):  # as systemd does (StateDirectory=)
        machine.run("install", "-d", "-m", "0700", "-o", user, "-g", user, f"/var/lib/{user}")
    backend = machine.run(*by(machine, "backend"), code=1)
    assert "say where the ledger's connection.json is" in backend


def test_the_command_line(installed):
    machine = installed[0]
    assert re.fullmatch(r"wonderland, version \d+\.\d+\.\d+\n", machine.run("wonderland", "--version"))
    shutil.copytree(VECTORS, machine.root / "tmp/vectors")
    verify = ("wonderland", "evidence", "verify", "/tmp/vectors/good.json", "--trust", "/tmp/vectors/trust.json")
    assert "13 decision" in machine.run(*verify)
    listed = machine.run("wonderland", "--help")
    assert {"backend", "evidence", "ledger", "network", "pad", "remote-id", "uav", "uwb"} <= set(listed.split())
    assert "is in wonderland-simulator, which is not installed" in machine.run("wonderland", "demo", code=1)


def test_the_backend_serves_and_agents_take_their_settings(installed):
    machine = installed[0]
    settings = machine.root / "etc/wonderland/backend.toml"
    more = 'connection = "/etc/wonderland/backend/connection.json"\nlisten = "127.0.0.1:8123"\n'
    settings.write_text(settings.read_text() + more)
    told = machine.run("sh", "-c", SERVED, "sh", *by(machine, "backend"))
    assert "health" in told
    assert "Set this server up: name its first administrator" in told
    assert int(re.findall(r"script (\d+)", told)[0]) > 10_000
    database = machine.root / "var/lib/wonderland-backend/wonderland.db"
    assert database.stat().st_mode & 0o077 == 0
    pad = 'pad_id = "pad-1"\nconnection = "pad/connection.json"\nidentity = "pad-1"\nspool = "/var/lib/wonderland/s"\n'
    pad += "".join(f'[[anchors]]\nanchor_id = "A{n}"\nport = "/dev/ttyACM{n}"\n' for n in range(4))
    (machine.root / "etc/wonderland/pad.toml").write_text(pad)
    uav = 'connection = "/etc/wonderland/uav/connection.json"\nport = "/dev/ttyUSB0"\npads = ["pad-1"]\n'
    uav += 'position = "mavlink:serial:/dev/ttyAMA0"\nbackend = "wss://console.example/ingest"\n[flight]\n'
    (machine.root / "etc/wonderland/uav.toml").write_text(uav)
    for service in ("pad", "uav"):
        user, command = exec_start(machine, service)
        said = machine.run(
            "setpriv", f"--reuid={user}", f"--regid={user}", "--init-groups", *command.split(), "--check"
        )
        assert "until a committed verdict permits the landing" in said or service == "pad"


def test_a_file_system_that_is_full_and_a_port_that_is_taken(installed):
    machine = installed[0]
    migrate = "wonderland backend migrate --database sqlite:////mnt/full.db"
    full = f"mount -t tmpfs -o size=300k tmpfs /mnt; {migrate}; mount -o remount,size=20m /mnt; {migrate}"
    said = machine.run("sh", "-c", full)
    assert "Error: the database was not migrated and is as it was: database or disk is full\n" in said
    assert "The tables are at revision" in said
    assert "Traceback" not in said
    away = machine.run("wonderland", "backend", "migrate", "--database", "postgresql://x@127.0.0.1:9/x", code=1)
    assert away.startswith("Error: the database cannot be used: connection failed")
    taken = '/usr/lib/wonderland/bin/python3 -m http.server --bind 127.0.0.1 8123 >/dev/null 2>&1 & sleep 1; exec "$@"'
    said = machine.run("sh", "-c", taken, "sh", *by(machine, "backend"), code=1)
    assert "cannot listen on 127.0.0.1:8123 (Address already in use)" in said


def test_an_upgrade_keeps_what_somebody_has_written(installed, packages, tmp_path):
    """Another build of wonderland-uav, whose own file has changed, too."""
    machine = installed[0]
    tree, newer = tmp_path / "tree", machine.root / "tmp" / "newer.deb"
    subprocess.run(["dpkg-deb", "--raw-extract", packages["wonderland-uav"], tree], check=True)
    control = tree / "DEBIAN" / "control"
    control.write_text(re.sub(r"^Version: .*$", "Version: 9.9-1", control.read_text(), flags=re.MULTILINE))
    (tree / "etc/wonderland/uav.toml").write_text("# another one\n")
    subprocess.run(
        ["dpkg-deb", "-Znone", "--root-owner-group", "--build", tree, newer], check=True, capture_output=True
    )
    refused = machine.run("dpkg", "--install", "/tmp/newer.deb", code=1)
    assert "depends on wonderland (= " not in refused or "dependency problems" in refused
    mine = (machine.root / "etc/wonderland/uav.toml").read_text()
    machine.run("dpkg", "--install", "--force-confold", "/tmp/newer.deb")
    assert (machine.root / "etc/wonderland/uav.toml").read_text() == mine
    assert (machine.root / "etc/wonderland/uav.toml.dpkg-dist").read_text() == "# another one\n"
    assert not list(machine.root.glob("etc/systemd/system/*.wants/wonderland*"))


def test_removed_it_keeps_data_and_purged_nothing_is_left(installed):
    machine, before, _ = installed
    machine.run("dpkg", "--remove", "wonderland-backend", "wonderland-pad", "wonderland-uav", "wonderland")
    assert not (machine.root / "usr/lib/wonderland").exists()
    assert (machine.root / "var/lib/wonderland-backend/wonderland.db").exists()
    assert (machine.root / "etc/wonderland/backend.toml").exists()
    # Keys and connections are whoever's put them there.
    shutil.rmtree(machine.root / "etc/wonderland/backend")
    shutil.rmtree(machine.root / "etc/wonderland/pad")
    shutil.rmtree(machine.root / "etc/wonderland/uav")
    machine.run("dpkg", "--purge", "wonderland-backend", "wonderland-pad", "wonderland-uav", "wonderland")
    assert machine.files() - before == set()
