"""compose.yaml: the whole system in containers, from the description of a network. Pure.

Orderers, peers, CAs and contract servers get the commands, the environment and the settings files that a network on
this machine gets; only hosts and paths differ. Profiles: ``raft``, ``bft`` and ``embedded`` say which ledger. Source:
the Compose specification (compose-spec).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import yaml

from wonderland import __version__
from wonderland_fabric_network.binaries import BY_NAME
from wonderland_fabric_network.description import EACH, NetworkDescription
from wonderland_fabric_network.hosts import CONTRACT
from wonderland_fabric_network.layout import NetworkDirectory
from wonderland_fabric_network.network import Network
from wonderland_fabric_network.ports import USUAL, Ports, allot

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from wonderland_fabric_network.network import Member
    from wonderland_fabric_network.processes import Launch

RAFT: Final = "raft"
BFT: Final = "bft"
EMBEDDED: Final = "embedded"
IMAGES: Final = {
    "wonderland": f"wonderland:{__version__}",
    "ca": "hyperledger/fabric-ca:1.5.21",
    "orderer": "hyperledger/fabric-orderer:3.1.5",
    "peer": "hyperledger/fabric-peer:3.1.5",
    "postgres": "postgres:17.6-bookworm",
}
OWNER: Final = 10_001
"""User and group of everything but the database; the image of this project has directories for it."""
POSTGRES_OWNER: Final = 999
SHARED: Final = "/network"
SLOT: Final = "a"
"""In containers a new version of the contract takes the place of the former one; there is no second server."""
_DESCRIPTION: Final = "/etc/wonderland/network.yaml"
_LEDGER: Final = "/run/wonderland/ledger"
_SECRETS: Final = "/run/wonderland/secrets"
_CONSOLE_PORT: Final = 8080
_EMBEDDED_PORT: Final = 7051
_WATCHED: Final = USUAL["peer"]["operations"]
_SCRATCH: Final = "/tmp:size=64m,mode=1777"  # noqa: S108 - a file system of the container's own
_COMPLETED: Final = "service_completed_successfully"
_HEALTHY: Final = "service_healthy"
_HEADER: Final = """\
# The whole system in containers: `docker compose up`, then `docker compose logs backend` shows the link to the console.
# COMPOSE_PROFILES in .env says on which ledger: raft, bft or embedded. docs/operate/containers.md tells the rest.
#
# Made by `wonderland network compose` from deploy/network.yaml (`make compose`): change that, not this.
"""


def compose_yaml(description: NetworkDescription) -> bytes:
    """The file for a network. Raises `DescriptionError`."""
    text: str = yaml.dump(compose(description), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=118)
    return (_HEADER + text).encode()


def compose(description: NetworkDescription) -> dict[str, Any]:
    """The document for a network. Raises `DescriptionError`."""
    each = description.with_hosts(EACH)
    raft = each if each.ordering.consensus == RAFT else each.with_ordering(RAFT)
    networks = {RAFT: _network(raft), BFT: _network(each.with_ordering(BFT))}
    return {
        "name": "wonderland",
        "services": {**_fabric(networks), **_embedded(), **_project()},
        "networks": {
            "ledger": {"internal": True},
            "agents": {"internal": True},
            "database": {"internal": True},
            "console": {},
        },
        "volumes": {name: {} for name in ("network", "ledger", "clients", "secrets", "database", "world")},
        "configs": {
            f"network-{profile}": {"content": _literal(network.description.to_yaml().decode())}
            for profile, network in networks.items()
        },
    }


def _network(description: NetworkDescription) -> Network:
    directory = NetworkDirectory(Path(SHARED))
    ports: Ports = allot(directory.ports_file, description, bytes)
    return Network(directory, description, ports)


def _fabric(networks: Mapping[str, Network]) -> dict[str, Any]:
    """CAs, orderers, peers, contract servers, and the jobs that bring them up, in the order in which they start."""
    both = list(networks)
    services: dict[str, Any] = {
        f"prepare-{profile}": {
            **_job(["network", "prepare", "--dir", SHARED, "--file", _DESCRIPTION], [profile], [_volume("network")]),
            "network_mode": "none",
            "configs": [{"source": f"network-{profile}", "target": _DESCRIPTION}],
        }
        for profile in both
    }
    prepared = _after({f"prepare-{profile}": _COMPLETED for profile in both}, required=False)
    found: dict[str, tuple[dict[str, Any], list[str]]] = {}
    for profile, network in networks.items():
        for name, service in _servers(network, prepared).items():
            found.setdefault(name, (service, []))[1].append(profile)
    certified_by = {name: _HEALTHY for name in found if name.startswith("ca.")}
    services |= {
        name: {**service, "profiles": profiles} for name, (service, profiles) in found.items() if name in certified_by
    }
    services["certify"] = {
        **_job(["network", "certify", "--dir", SHARED], both, [_volume("network")], ["ledger"]),
        "depends_on": _after(certified_by),
    }
    services |= {
        name: {**service, "profiles": profiles}
        for name, (service, profiles) in found.items()
        if name not in certified_by
    }
    joins = {name: _HEALTHY for name in found if name not in certified_by}
    always = {name for name in joins if found[name][1] == both}
    services["join"] = {
        **_job(["network", "join", "--dir", SHARED], both, [_volume("network")], ["ledger"]),
        "depends_on": {
            name: {"condition": condition, **({} if name in always else {"required": False})}
            for name, condition in joins.items()
        },
    }
    services["identities-fabric"] = {
        **_job(
            ["world", "enrol", "--network", SHARED, "--to", "/clients"],
            both,
            [_volume("network"), _volume("clients")],
            ["ledger"],
        ),
        "depends_on": _after({"join": _COMPLETED}),
    }
    return services


def _servers(network: Network, prepared: dict[str, Any]) -> dict[str, Any]:
    """By name of their host: a network's CAs, orderers, peers and contract servers."""
    certified = _after({"certify": _COMPLETED})
    servers: dict[str, Any] = {}
    for msp_id in network.msp_ids:
        home = network.directory.organisation(msp_id).ca_home
        launch = network.authority(msp_id).launch(BY_NAME.ca_server)
        servers[network.hosts.of(msp_id, "ca")] = {
            **_server("ca", launch, [_volume("network", home)], "192M"),
            "tmpfs": [_SCRATCH],
            "depends_on": prepared,
        }
    for kind, members in (("orderer", network.orderers), ("peer", network.peers)):
        for member in members:
            servers[network.hosts.of(member.msp_id, member.name)] = {
                **_server(kind, _launch(network, kind, member), [_volume("network", network.node(member).path)], "1G"),
                # The image declares the last two as volumes; nothing is kept there.
                "tmpfs": [_SCRATCH, "/etc/hyperledger/fabric:size=1m", "/var/hyperledger:size=1m"],
                "depends_on": certified,
            }
    for msp_id in network.endorsers:
        node = network.directory.organisation(msp_id).node(CONTRACT)
        launch = network.launch_contract(msp_id, SLOT)
        servers[network.hosts.of(msp_id, f"{CONTRACT}-{SLOT}")] = {
            **_server("wonderland", launch, [_volume("network", node.path, read_only=True)], "256M"),
            "tmpfs": [_SCRATCH],
            "healthcheck": _check("wonderland", "chaincode", "health", "--at", f"127.0.0.1:{_WATCHED}"),
            "depends_on": certified,
        }
    return servers


def _launch(network: Network, kind: str, member: Member) -> Launch:
    return (network.launch_orderer if kind == "orderer" else network.launch_peer)(member, BY_NAME)


def _embedded() -> dict[str, Any]:
    """The single-node ledger, and its clients' identities."""
    command = ["ledger", "start", "--data", "/ledger", "--listen", f"0.0.0.0:{_EMBEDDED_PORT}", "--advertise", "ledger"]
    return {
        "ledger": {
            **_base("wonderland", "256M"),
            "command": ["wonderland", *command],
            "profiles": [EMBEDDED],
            "networks": ["ledger"],
            "volumes": [_volume("ledger")],
            "tmpfs": [_SCRATCH],
            "healthcheck": _check("bash", "-c", f"exec 3<>/dev/tcp/127.0.0.1/{_EMBEDDED_PORT}"),
        },
        "identities-embedded": {
            **_job(
                ["world", "enrol", "--ledger", "/ledger", "--to", "/clients"],
                [EMBEDDED],
                [_volume("ledger"), _volume("clients")],
                ["ledger"],
            ),
            "depends_on": _after({"ledger": _HEALTHY}),
        },
    }


def _project() -> dict[str, Any]:
    """What every profile has: database, backend with console, simulated pads and drones."""
    identified = _after({"identities-fabric": _COMPLETED, "identities-embedded": _COMPLETED}, required=False)
    url = f"postgresql://wonderland_server@postgres/wonderland?passfile={_SECRETS}/server/pgpass"
    owner_url = f"postgresql://wonderland@postgres/wonderland?passfile={_SECRETS}/owner/pgpass"
    return {
        "secrets": {
            **_job(["backend", "new-password", "--to", "/secrets"], [], [_volume("secrets")]),
            "network_mode": "none",
        },
        "postgres": {
            **_base("postgres", "1G"),
            "user": f"{POSTGRES_OWNER}:{POSTGRES_OWNER}",
            "group_add": [str(OWNER)],
            "environment": {
                "POSTGRES_USER": "wonderland",
                "POSTGRES_DB": "wonderland",
                "POSTGRES_PASSWORD_FILE": f"{_SECRETS}/owner/password",
            },
            "networks": ["database"],
            "volumes": [
                _volume("database", Path("/var/lib/postgresql/data"), whole=True),
                _volume("secrets", Path(_SECRETS) / "owner", subpath="owner", read_only=True),
            ],
            "tmpfs": [_SCRATCH, f"/var/run/postgresql:size=1m,uid={POSTGRES_OWNER},gid={POSTGRES_OWNER},mode=0755"],
            "shm_size": "128M",
            "stop_signal": "SIGINT",
            "healthcheck": _check("pg_isready", "--username", "wonderland", "--dbname", "wonderland"),
            "depends_on": _after({"secrets": _COMPLETED}),
        },
        "migrate": {
            **_job(
                [
                    *("backend", "migrate", "--server-role", "wonderland_server"),
                    *("--server-password-file", f"{_SECRETS}/server/password"),
                ],
                [],
                [_volume("secrets", Path(_SECRETS), whole=True, read_only=True)],
                ["database"],
            ),
            "environment": {"WONDERLAND_BACKEND_DATABASE": _literal(owner_url)},
            "depends_on": _after({"postgres": _HEALTHY}),
        },
        "backend": {
            **_base("wonderland", "512M"),
            "build": ".",
            "command": [
                *("wonderland", "backend", "serve", "--listen", f"0.0.0.0:{_CONSOLE_PORT}", "--plaintext"),
                *("--connection", f"{_LEDGER}/connection.json"),
                *("--public-url", f"http://127.0.0.1:${{CONSOLE_PORT:-{_CONSOLE_PORT}}}"),
            ],
            "environment": {
                "WONDERLAND_BACKEND_DATABASE": _literal(url),
                "WONDERLAND_BACKEND_AUDIT_IDENTITY": "mirror",
                "WONDERLAND_BACKEND_METRICS_TOKEN_FILE": f"{_SECRETS}/server/metrics-token",
                "WONDERLAND_BACKEND_WEBHOOK_KEY_FILE": f"{_SECRETS}/server/webhook.key",
            },
            "ports": [
                {
                    "target": _CONSOLE_PORT,
                    "published": f"${{CONSOLE_PORT:-{_CONSOLE_PORT}}}",
                    "host_ip": "127.0.0.1",
                    "protocol": "tcp",
                }
            ],
            "networks": ["ledger", "agents", "database", "console"],
            "volumes": [
                _volume("clients", Path(_LEDGER), subpath="backend", read_only=True),
                _volume("secrets", Path(_SECRETS) / "server", subpath="server", read_only=True),
            ],
            "tmpfs": [_SCRATCH],
            "healthcheck": _check("wonderland", "backend", "health", "--at", f"http://127.0.0.1:{_CONSOLE_PORT}"),
            "depends_on": {**identified, **_after({"migrate": _COMPLETED})},
        },
        "world": {
            **_base("wonderland", "2G"),
            "command": [
                *("wonderland", "world", "run", "--dir", "/world"),
                *("--connection", f"{_LEDGER}/connection.json", "--backend", f"http://backend:{_CONSOLE_PORT}"),
            ],
            "networks": ["ledger", "agents"],
            "volumes": [_volume("world"), _volume("clients", Path(_LEDGER), subpath="world", read_only=True)],
            "tmpfs": [_SCRATCH],
            "healthcheck": _check("wonderland", "world", "health", "--dir", "/world"),
            "depends_on": {**identified, **_after({"backend": _HEALTHY})},
        },
    }


def _server(kind: str, launch: Launch, volumes: list[dict[str, Any]], memory: str) -> dict[str, Any]:
    return {
        **_base(kind, memory),
        "command": [_literal(each) for each in launch.arguments],
        **(
            {"environment": {name: _literal(value) for name, value in launch.environment.items()}}
            if launch.environment
            else {}
        ),
        "networks": ["ledger"],
        "volumes": volumes,
        "healthcheck": _check("bash", "-c", _ask_health(_WATCHED)),
    }


def _job(
    command: Sequence[str], profiles: list[str], volumes: list[dict[str, Any]], networks: Sequence[str] = ()
) -> dict[str, Any]:
    return {
        **_base("wonderland", "256M"),
        "command": ["wonderland", *command],
        **({"profiles": profiles} if profiles else {}),
        **({"networks": list(networks)} if networks else {}),
        "volumes": volumes,
        "tmpfs": [_SCRATCH],
        "restart": "no",
    }


def _base(image: str, memory: str) -> dict[str, Any]:
    """What all have: no root, no privileges, nothing written but to volumes, bounds for everything that grows."""
    return {
        "image": IMAGES[image],
        "user": f"{OWNER}:{OWNER}",
        "init": True,
        "read_only": True,
        "cap_drop": ["ALL"],
        "security_opt": ["no-new-privileges:true"],
        "restart": "unless-stopped",
        "stop_grace_period": "30s",
        "deploy": {"resources": {"limits": {"cpus": "2.0", "memory": memory, "pids": 512}}},
        "logging": {"driver": "local", "options": {"max-size": "10m", "max-file": "3"}},
    }


def _volume(
    name: str,
    target: Path | None = None,
    *,
    subpath: str = "",
    whole: bool = False,
    read_only: bool = False,
) -> dict[str, Any]:
    """A named volume at its own path; or, at `target`, the whole of it or the part that a job has made there."""
    mount: dict[str, Any] = {"type": "volume", "source": name, "target": str(target or f"/{name}")}
    if read_only:
        mount["read_only"] = True
    if target is not None and not whole:
        mount["volume"] = {"nocopy": True, "subpath": subpath or str(target.relative_to(f"/{name}"))}
    return mount


def _check(*command: str) -> dict[str, Any]:
    return {
        "test": ["CMD", *(_literal(each) for each in command)],
        "interval": "30s",
        "timeout": "10s",
        "retries": 3,
        "start_period": "120s",
        "start_interval": "1s",
    }


def _ask_health(port: int) -> str:
    """Fabric's images have no program that asks for a page, but bash."""
    request = r"GET /healthz HTTP/1.0\r\n\r\n"
    return f"exec 3<>/dev/tcp/127.0.0.1/{port} && printf '{request}' >&3 && head -n 1 <&3 | grep -q ' 200 '"


def _after(conditions: Mapping[str, str], *, required: bool = True) -> dict[str, Any]:
    """Services to wait for; those that another profile has are not required."""
    return {
        name: {"condition": condition, **({} if required else {"required": False})}
        for name, condition in conditions.items()
    }


def _literal(text: str) -> str:
    """A text in which Compose replaces nothing."""
    return text.replace("$", "$$")


class _Dumper(yaml.SafeDumper):
    """YAML for people: no aliases, lists indented, texts of several lines as they are."""

    def ignore_aliases(self, data: Any) -> bool:
        del data
        return True

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        del indentless
        super().increase_indent(flow, indentless=False)


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style="|" if "\n" in text else None)


_Dumper.add_representer(str, _represent_text)
