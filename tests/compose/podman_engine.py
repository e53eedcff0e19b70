"""The same engine with real containers: each service of a compose.yaml by ``podman run``, from images.

Order of start, conditions, health checks and published names are the engine's; file systems, users, networks, names,
and capabilities are podman's (limits need control groups, which may not be there). A part of a volume (`subpath`, podman 5 and Docker 26 know it) is mounted by its
place on this machine, and logs go to files (podman has no driver `local`).
"""

from __future__ import annotations

import asyncio
import contextlib
import subprocess
from pathlib import Path

from engine import Engine, EngineError

RUN = ["--cgroups=no-conmon", "--ulimit=nofile=4096:4096", "--ulimit=nproc=4096:4096", "--log-driver=none"]


def podman(*command, check=True):
    done = subprocess.run(["podman", *map(str, command)], capture_output=True, text=True, check=False)
    if check and done.returncode:
        raise EngineError(f"podman {' '.join(map(str, command))}: {done.stderr}")
    return done.stdout.strip()


def _tmpfs(text):
    """podman gives a tmpfs no owner, as Docker does: everybody may write to it then."""
    path, _, options = text.partition(":")
    kept = [each for each in options.split(",") if each and not each.startswith(("uid=", "gid=", "mode="))]
    return f"{path}:{','.join([*kept, 'mode=1777'])}"


class PodmanEngine(Engine):
    """`images`: image by image of the file. Whatever it makes is called `prefix`…; `remove` removes it."""

    def __init__(self, file, profile, work, *, prefix, images, runtime, variables=None):
        super().__init__(file, profile, work, variables)
        self.prefix = prefix
        self.images = images
        self.runtime = runtime
        self._volumes = {}

    def connect(self):
        """Networks and volumes."""
        self.remove()
        for name, each in self.document["networks"].items():
            podman("network", "create", *(["--internal"] if each and each.get("internal") else []), self._named(name))
        for name in self.document["volumes"]:
            podman("volume", "create", self._named(name))
            self._volumes[name] = Path(podman("volume", "inspect", "--format", "{{.Mountpoint}}", self._named(name)))

    def remove(self):
        """All of it."""
        for service in self.services.values():
            podman("rm", "--force", "--time=0", self._named(service.name), check=False)
        for name in self.document["networks"]:
            podman("network", "rm", "--force", self._named(name), check=False)
        for name in self.document["volumes"]:
            podman("volume", "rm", "--force", self._named(name), check=False)

    async def publish(self):
        """podman has done it."""

    def _named(self, name):
        return f"{self.prefix}-{name}"

    def _process(self, service):
        document = service.document
        command = ["podman", f"--runtime={self.runtime}", "run", "--rm", "--name", self._named(service.name), *RUN]
        command += [f"--user={document['user']}", *(["--init"] if document.get("init") else [])]
        command += ["--read-only", "--read-only-tmpfs=false"] if document.get("read_only") else []
        command += [f"--cap-drop={each}" for each in document.get("cap_drop", ())]
        command += [f"--security-opt={each.removesuffix(':true')}" for each in document.get("security_opt", ())]
        command += [f"--group-add={each}" for each in document.get("group_add", ())]
        command += [f"--env={name}={value}" for name, value in document.get("environment", {}).items()]
        command += [f"--tmpfs={_tmpfs(each)}" for each in document.get("tmpfs", ())]
        command += [f"--shm-size={each}" for each in [document.get("shm_size")] if each]
        command += [f"--stop-signal={each}" for each in [document.get("stop_signal")] if each]
        command += [f"--network={self._named(name)}:alias={service.name}" for name in document.get("networks", ())]
        command += ["--network=none"] if document.get("network_mode") == "none" else []
        command += [
            f"--publish={each['host_ip']}:{each['published']}:{each['target']}" for each in document.get("ports", ())
        ]
        for each in document.get("volumes", ()):
            part = each.get("volume", {}).get("subpath")
            source = self._volumes[each["source"]] / part if part else self._named(each["source"])
            command.append(f"--volume={source}:{each['target']}{':ro' if each.get('read_only') else ''}")
        for each in document.get("configs", ()):
            source = self.work / "configs" / each["source"]
            source.parent.mkdir(exist_ok=True, parents=True)
            source.write_text(self.document["configs"][each["source"]]["content"])
            command.append(f"--volume={source}:{each['target']}:ro")
        return [*command, self.images[document["image"]], *document.get("command", ())]

    def _inside(self, service):
        return ["podman", f"--runtime={self.runtime}", "exec", self._named(service.name)]

    async def restart_killed(self, service):
        """Kill it as a crash would; returns when all servers are healthy again.

        Whatever ends meanwhile starts again, as `unless-stopped` says: it may be that it does not go on without the other.
        """
        podman("kill", "--signal=KILL", self._named(service.name))
        code = await service.process.wait()
        servers = [each for each in self.services.values() if not each.is_job]
        async with asyncio.timeout(240):
            while not all(await asyncio.gather(*map(self._lives, servers))):
                await asyncio.sleep(0.5)
        return code

    async def _lives(self, service):
        if service.process.returncode is not None:
            podman("rm", "--force", "--time=0", self._named(service.name), check=False)
            await self._launch(service)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(10):
                return (await self.execute(service, service.document["healthcheck"]["test"][1:]))[0] == 0
        return False
