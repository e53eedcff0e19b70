"""A small container engine for tests: runs the services of a compose.yaml in namespaces of this machine's kernel.

There is no container engine on the machines that test this. What Compose and an engine would do with a service is done
here with util-linux and iproute2, so that its exact command, environment, user, mounts, networks and health check run:

- a root file system of its own: /usr and what else programs need from this machine, read-only; the service's volumes,
  tmpfs and configs at their own paths; everything else is not there. Writing anywhere else fails, as with `read_only`;
- the service's user, no capabilities, no new privileges;
- a network namespace, joined to a bridge for each of its networks, and /etc/hosts with the names of the services that
  share a network with it. Published ports are forwarded by this process;
- `depends_on` with its conditions, `healthcheck`, `stop_signal`, `stop_grace_period`, profiles and interpolation.

What differs from an engine: programs come from this machine (the virtual environment, FABRIC_BIN, PostgreSQL) and not
from images, PostgreSQL's entrypoint is imitated, and limits of memory and processors are not enforced.

It runs as root inside ``unshare --mount --net --pid --fork --kill-child --mount-proc``: when it ends, all of it does.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
SHELL_ROOT = Path("/run/containers-of-the-test")
POSTGRES_BIN = sorted(Path("/usr/lib/postgresql").glob("*/bin"))
_VARIABLE = re.compile(r"\$\$|\$\{(\w+)(?::-([^}]*))?\}|\$")
_DURATION = re.compile(r"(\d+)(ms|s|m)")
_SETTINGS = "nsswitch.conf ld.so.cache ld.so.conf services protocols group alternatives ssl localtime"
_SYSTEM = (
    "for each in bin sbin lib lib64; do if [ -L /$each ]; then cp -P /$each $each; "
    "elif [ -d /$each ]; then mkdir $each; mount --bind /$each $each; mount -o remount,bind,ro $each; fi; done"
)
_POSTGRES = """#!/bin/sh
# What PostgreSQL's image does at its first start.
set -eu
if [ ! -s "$PGDATA/PG_VERSION" ]; then
  initdb --username="$POSTGRES_USER" --pwfile="$POSTGRES_PASSWORD_FILE" --auth-local=trust --auth-host=scram-sha-256 >&2
  echo "host all all all scram-sha-256" >> "$PGDATA/pg_hba.conf"
  echo "CREATE DATABASE \\"$POSTGRES_DB\\"" | postgres --single -j postgres >&2
fi
exec postgres -c listen_addresses='*'
"""


class EngineError(Exception):
    """A service that cannot be run, or did not do what others wait for; the text has the end of its log."""


def interpolate(value, variables):
    """Replace ``${NAME:-default}`` and ``$$`` in all texts of a document, as Compose does."""
    if isinstance(value, dict):
        return {name: interpolate(each, variables) for name, each in value.items()}
    if isinstance(value, list):
        return [interpolate(each, variables) for each in value]
    if not isinstance(value, str):
        return value

    def one(found):
        if found[0] == "$$":
            return "$"
        if found[1] is None:
            raise EngineError(f"a single $ in {value!r}")
        return variables.get(found[1]) or found[2] or ""

    return _VARIABLE.sub(one, value)


def seconds(text):
    """A duration of Compose in seconds."""
    return sum(int(number) * {"ms": 0.001, "s": 1, "m": 60}[unit] for number, unit in _DURATION.findall(text))


class Service:
    """One service: what the file says, its addresses, and its process."""

    def __init__(self, name, document, number):
        self.name = name
        self.document = document
        self.number = number
        self.namespace = f"s{number}"
        self.addresses = {}
        self.process = None
        self.completed = asyncio.Event()
        self.healthy = asyncio.Event()
        self.seconds_to_healthy = None

    @property
    def kind(self):
        return self.document["image"].partition(":")[0].rpartition("/")[2]

    @property
    def is_job(self):
        return self.document.get("restart") == "no"


class Engine:
    """The services of one profile."""

    def __init__(self, file, profile, work, variables=None):
        self.work = work
        document = interpolate(yaml.safe_load(file.read_text()), variables or {})
        self.document = document
        active = {
            name: each
            for name, each in document["services"].items()
            if not each.get("profiles") or profile in each["profiles"]
        }
        self.services = {name: Service(name, each, number) for number, (name, each) in enumerate(active.items(), 1)}
        self._tasks = set()
        self._forwards = []

    # --- networks

    def connect(self):
        """Bridges, a network namespace for each service, and who knows whom by name."""
        _run("mount --make-rprivate /; mount -t tmpfs tmpfs /run; mkdir /run/netns; ip link set lo up")
        numbers = {network: number for number, network in enumerate(self.document["networks"], 1)}
        for number in numbers.values():
            bridge = f"b{number}"
            _run(
                f"ip link add {bridge} type bridge; ip link set {bridge} up; ip addr add 10.88.{number}.1/24 dev {bridge}"
            )
        for service in self.services.values():
            _run(f"ip netns add {service.namespace}; ip -n {service.namespace} link set lo up")
            for network in service.document.get("networks", ()):
                number = numbers[network]
                inside, outside = f"e{number}", f"v{service.number}-{number}"
                address = f"10.88.{number}.{service.number + 10}"
                service.addresses[network] = address
                _run(
                    f"ip link add {outside} type veth peer name {inside} netns {service.namespace}; "
                    f"ip link set {outside} master b{number} up; "
                    f"ip -n {service.namespace} addr add {address}/24 dev {inside}; "
                    f"ip -n {service.namespace} link set {inside} up"
                )

    def _hosts(self, service):
        lines = ["127.0.0.1 localhost"]
        for other in self.services.values():
            shared = [network for network in service.addresses if network in other.addresses]
            if shared:
                lines.append(f"{other.addresses[shared[0]]} {other.name}")
        return "\n".join(lines) + "\n"

    async def publish(self):
        """Forward published ports of this (outer) network namespace."""
        for service in self.services.values():
            for port in service.document.get("ports", ()):
                internal = {name for name, each in self.document["networks"].items() if each and each.get("internal")}
                open_networks = [name for name in service.addresses if name not in internal]
                if not open_networks:
                    raise EngineError(f"{service.name}: a published port needs a network that is not internal")
                target = (service.addresses[open_networks[0]], port["target"])
                server = await asyncio.start_server(_forwarding(target), port["host_ip"], int(port["published"]))
                self._forwards.append(server)

    # --- file systems

    def _setup(self, service):
        """The shell script that becomes the service's process."""
        document, root = service.document, SHELL_ROOT / service.name
        lines = [
            "set -eu",
            f"mkdir -p {root} && mount -t tmpfs -o mode=0755 tmpfs {root} && cd {root}",
            "mkdir -p usr etc proc dev run var tmp opt image/bin",
            "mount --bind /usr usr; mount -o remount,bind,ro usr",
            f"for each in {_SETTINGS}; do if [ -e /etc/$each ]; then cp -a /etc/$each etc/; fi; done",
            _SYSTEM,
            "mount --bind /proc proc",
            "mount -t tmpfs -o mode=0755 tmpfs dev; mkdir dev/pts dev/shm; ln -s /proc/self/fd dev/fd",
            "for each in null zero full random urandom tty; do touch dev/$each; mount --bind /dev/$each dev/$each; done",
            "mount -t devpts -o newinstance,ptmxmode=0666,mode=0620 devpts dev/pts; ln -s pts/ptmx dev/ptmx",
            "mount -t tmpfs -o mode=1777 tmpfs dev/shm",
        ]
        mounts = [(each.partition(":")[0], self._tmpfs(each)) for each in document.get("tmpfs", ())]
        mounts += [(each["target"], self._bind(each)) for each in document.get("volumes", ())]
        mounts += [
            (str(path), f"mkdir -p .{path}; mount --bind {path} .{path}; mount -o remount,bind,ro .{path}")
            for path in _programs(service.kind)
        ]
        lines += [line for _, line in sorted(mounts, key=lambda each: each[0].count("/"))]
        own = self.work / "image" / service.name
        own.mkdir(parents=True, exist_ok=True)
        for config in document.get("configs", ()):
            source = own / config["source"]
            source.write_text(self.document["configs"][config["source"]]["content"])
            lines.append(_file(source, config["target"]))
        (own / "hosts").write_text(self._hosts(service))
        (own / "passwd").write_text(
            "root:x:0:0::/:/bin/sh\npostgres:x:999:999::/:/bin/sh\nwonderland:x:10001:10001::/nonexistent:/bin/sh\n"
        )
        lines += [_file(own / "hosts", "/etc/hosts"), _file(own / "passwd", "/etc/passwd")]
        for name, content in self._image(service.kind).items():
            file = own / name.replace("/", "_")
            file.write_bytes(content if isinstance(content, bytes) else content.encode())
            file.chmod(0o755)
            lines.append(_file(file, name))
        if document.get("read_only"):
            lines.append(f"mount -o remount,ro {root}")
        lines.append(f"exec chroot {root} {shlex.join(self._entry(service))} {shlex.join(self._command(service))}")
        return "\n".join(lines)

    def _tmpfs(self, text):
        path, _, options = text.partition(":")
        return f"mkdir -p .{path}; mount -t tmpfs -o {options or 'mode=1777'} tmpfs .{path}"

    def _bind(self, mount):
        options = mount.get("volume", {})
        source = self.work / "volumes" / mount["source"]
        target = mount["target"]
        if not source.exists():
            # A volume that is mounted for the first time takes owner and mode of the image's directory.
            source.mkdir(parents=True)
            owner, mode = (999, 0o700) if target.startswith("/var/lib/postgresql") else (10_001, 0o750)
            os.chown(source, owner, owner)
            source.chmod(mode)
        source /= options.get("subpath", "")
        line = f'test -e {source} || {{ echo "no such path in the volume: {source}" >&2; exit 125; }}; '
        line += f"mkdir -p .{target}; mount --bind {source} .{target}"
        return line + (f"; mount -o remount,bind,ro .{target}" if mount.get("read_only") else "")

    def _image(self, kind):
        """Programs at paths where the image has them."""
        if kind == "postgres":
            return {"/image/bin/postgres-entrypoint": _POSTGRES}
        if kind == "wonderland":
            python = shlex.join([sys.executable, "-m", "wonderland.cli"])
            return {"/image/bin/wonderland": f'#!/bin/sh\nexec {python} "$@"\n'}
        program = {"fabric-ca": "fabric-ca-server", "fabric-orderer": "orderer", "fabric-peer": "peer"}[kind]
        directory = Path(os.environ["FABRIC_BIN"]).absolute()
        files = {f"/image/bin/{program}": f'#!/bin/sh\nexec {directory / program} "$@"\n'}
        if kind == "fabric-peer":
            for name in ("detect", "build", "release"):
                files[f"/opt/hyperledger/ccaas_builder/bin/{name}"] = _builder(name)
        return files

    def _command(self, service):
        if service.kind == "postgres":
            return ["postgres-entrypoint"]
        return service.document["command"]

    def _entry(self, service):
        """User, privileges and environment."""
        document = service.document
        user, _, group = document["user"].partition(":")
        groups = ",".join(document.get("group_add", ())) or None
        path = "/image/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
        environment = {"HOME": "/"}
        if service.kind == "postgres":
            path = f"/image/bin:{POSTGRES_BIN[-1]}:{path}"
            environment |= {"PGDATA": "/var/lib/postgresql/data", "LANG": "C.UTF-8"}
        if service.kind == "wonderland":
            environment |= {"PYTHONUNBUFFERED": "1", "PYTHONDONTWRITEBYTECODE": "1", "HOME": "/nonexistent"}
        environment |= {"PATH": path, **document.get("environment", {})}
        return [
            *("setpriv", f"--reuid={user}", f"--regid={group}", f"--groups={groups}" if groups else "--clear-groups"),
            *(["--inh-caps=-all", "--bounding-set=-all"] if document.get("cap_drop") == ["ALL"] else []),
            *(["--no-new-privs"] if "no-new-privileges:true" in document.get("security_opt", ()) else []),
            *("env", "-i", *(f"{name}={value}" for name, value in environment.items())),
        ]

    # --- processes

    async def start(self):
        """Start all in their order; returns when all are healthy, and all jobs are done. Raises `EngineError`."""
        (self.work / "logs").mkdir(parents=True, exist_ok=True)
        async with asyncio.TaskGroup() as group:
            for service in self.services.values():
                group.create_task(self._start(service))

    async def _start(self, service):
        for name, wait in service.document.get("depends_on", {}).items():
            if name not in self.services:
                if wait.get("required", True):
                    raise EngineError(f"{service.name} needs {name}, which this profile does not have")
                continue
            other = self.services[name]
            await (other.completed if wait["condition"] == "service_completed_successfully" else other.healthy).wait()
        begin = asyncio.get_running_loop().time()
        await self._launch(service)
        if service.is_job:
            code = await service.process.wait()
            if code:
                raise EngineError(f"{service.name} ended with {code}:\n{self.tail(service)}")
            service.completed.set()
        else:
            await self._wait_healthy(service)
            service.healthy.set()
        service.seconds_to_healthy = asyncio.get_running_loop().time() - begin

    async def _launch(self, service):
        with self.log(service).open("ab") as log:
            service.process = await asyncio.create_subprocess_exec(
                *self._process(service),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def _process(self, service):
        """The command that becomes the service."""
        namespace = f"--net=/run/netns/{service.namespace}"
        return ["nsenter", namespace, "unshare", "--mount", "sh", "-c", self._setup(service)]

    async def _wait_healthy(self, service):
        check = service.document["healthcheck"]
        # Longer than Compose would: the machine that tests may be busy.
        deadline = asyncio.get_running_loop().time() + 2 * seconds(check["start_period"])
        while True:
            if service.process.returncode is not None:
                raise EngineError(f"{service.name} ended with {service.process.returncode}:\n{self.tail(service)}")
            try:
                async with asyncio.timeout(seconds(check["timeout"])):
                    code, output = await self.execute(service, check["test"][1:])
            except TimeoutError:
                code, output = -1, b"no answer in time"
            if code == 0:
                return
            if asyncio.get_running_loop().time() > deadline:
                raise EngineError(f"{service.name} is not healthy ({output.decode()}):\n{self.tail(service)}")
            await asyncio.sleep(seconds(check["start_interval"]))

    async def execute(self, service, command):
        """Run a command inside, as `docker compose exec` does; exit code and output."""
        process = await asyncio.create_subprocess_exec(
            *self._inside(service),
            *command,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
        )
        try:
            output, _ = await process.communicate()
        except BaseException:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
            raise
        return process.returncode, output

    def _inside(self, service):
        target = f"--target={service.process.pid}"
        return ["nsenter", target, "--mount", "--net", "--root", "--wd", *self._entry(service)]

    async def stop(self):
        """Stop all, those that depend on others first; exit code by name."""
        for server in self._forwards:
            server.close()
        self._forwards.clear()
        waiting = {
            name: [each for each, other in self.services.items() if name in other.document.get("depends_on", {})]
            for name in self.services
        }
        ended = {name: asyncio.Event() for name in self.services}

        async def stop(service):
            for name in waiting[service.name]:
                await ended[name].wait()
            process = service.process
            if process is not None and process.returncode is None:
                number = signal.Signals[service.document.get("stop_signal", "SIGTERM")]
                process.send_signal(number)
                try:
                    await asyncio.wait_for(process.wait(), seconds(service.document["stop_grace_period"]))
                except TimeoutError:
                    process.kill()
                    await process.wait()
            ended[service.name].set()

        async with asyncio.TaskGroup() as group:
            for service in self.services.values():
                group.create_task(stop(service))
        codes = {name: each.process.returncode for name, each in self.services.items() if each.process is not None}
        for service in self.services.values():
            service.completed, service.healthy, service.process = asyncio.Event(), asyncio.Event(), None
        return codes

    def log(self, service):
        return self.work / "logs" / f"{service.name}.log"

    def tail(self, service, lines=25):
        with contextlib.suppress(OSError):
            return "\n".join(self.log(service).read_text(errors="replace").splitlines()[-lines:])
        return ""

    def resident_bytes(self, service):
        """Memory of a service's processes, counted as a control group would, but for what they share."""
        children = {}
        for path in Path("/proc").glob("[0-9]*/stat"):
            with contextlib.suppress(OSError, ValueError):
                fields = path.read_text().rpartition(")")[2].split()
                children.setdefault(int(fields[1]), []).append(int(path.parent.name))
        total, todo = 0, [service.process.pid]
        while todo:
            pid = todo.pop()
            todo += children.get(pid, [])
            with contextlib.suppress(OSError):
                for line in (Path("/proc") / str(pid) / "smaps_rollup").read_text().splitlines():
                    if line.startswith("Pss:"):
                        total += int(line.split()[1]) * 1024
        return total


def _programs(kind):
    """Directories of this machine that a kind's programs need, beside /usr."""
    needed = {Path(sys.prefix), Path(sys.base_prefix), ROOT}
    if kind.startswith("fabric-"):
        needed.add(Path(os.environ["FABRIC_BIN"]).absolute())
    return sorted(path for path in needed if not path.is_relative_to("/usr"))


def _builder(name):
    given = os.environ.get("CCAAS_BUILDER")  # Fabric's own, where somebody has built it
    if given:
        return Path(given, name).read_bytes()
    module = ROOT / "libraries" / "fabric_network" / "wonderland_fabric_network" / "builder.py"
    return f'#!/bin/sh\nexec {shlex.join([sys.executable, "-I", "-S", str(module), name])} "$@"\n'


def _file(source, target):
    """A line that shows a file of this machine at a path, read-only."""
    return f"mkdir -p .{Path(target).parent}; [ -e .{target} ] || touch .{target}; mount --bind {source} .{target}"


def _forwarding(target):
    async def one(reader, writer):
        try:
            there_reader, there_writer = await asyncio.open_connection(*target)
        except OSError:
            writer.close()
            return
        await asyncio.gather(_copy(reader, there_writer), _copy(there_reader, writer))

    return one


async def _copy(reader, writer):
    with contextlib.suppress(OSError):
        while data := await reader.read(65_536):
            writer.write(data)
            await writer.drain()
    with contextlib.suppress(OSError):
        writer.close()


def _run(script):
    done = subprocess.run(["sh", "-ec", script], capture_output=True, text=True, check=False)
    if done.returncode:
        raise EngineError(f"{script}: {done.stderr}")
