"""A Zenoh session as rmw_zenoh's peers have it, with this machine alone unless certificates say who is who."""

from __future__ import annotations

import ipaddress
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import zenoh

from wonderland_rmw_zenoh.errors import SessionError

ROUTER: Final = "tcp/127.0.0.1:7447"
"""Where rmw_zenoh's own router is."""
MAX_MESSAGE_BYTES: Final = 16 << 20
_ENDPOINT: Final = re.compile(r"(tcp|tls)/(\[[0-9a-fA-F:.]+\]|[A-Za-z0-9.-]+):(\d{1,5})")
_ALL: Final = (
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)


@dataclass(frozen=True, slots=True)
class Tls:
    """Who this peer is, and who vouches for the others (PEM files). ``names``: the others' common names; empty: all."""

    ca: Path
    certificate: Path
    key: Path
    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Link:
    """Where a session connects to and listens."""

    connect: Sequence[str] = (ROUTER,)
    listen: Sequence[str] = ("tcp/127.0.0.1:0",)
    tls: Tls | None = None
    mode: Literal["peer", "router"] = "peer"
    """A router brings others together, as rmw_zenohd does."""
    max_message_bytes: int = MAX_MESSAGE_BYTES

    def problem(self) -> str:
        """Why no session is opened with this; empty where one is."""
        for name, endpoints in (("connect", self.connect), ("listen", self.listen)):
            for each in endpoints:
                found = _ENDPOINT.fullmatch(each)
                if found is None or int(found[3]) > 0xFFFF:
                    return f"{name}: {each!r} is no address, for example {ROUTER} or tls/pad.example:7447"
                if self.tls is not None and found[1] != "tls":
                    return f"{name}: {each} is not encrypted; with certificates all addresses begin with tls/"
                if self.tls is None and found[1] == "tls":
                    return f"{name}: {each} needs certificates (tls: ca, certificate, key)"
                if self.tls is None and not _is_loopback(found[2].strip("[]")):
                    return (
                        f"{name}: {each} is another machine's, and whoever reaches it could speak as anybody; give "
                        "certificates (tls: ca, certificate, key) and tls/ addresses, or stay on 127.0.0.1"
                    )
        return ""


def open_session(link: Link) -> zenoh.Session:
    """A session; it blocks for half a second where the router is away, and finds it later. Raises SessionError."""
    problem = link.problem()
    if problem:
        raise SessionError(problem)
    config = zenoh.Config()
    try:
        for name, value in _settings(link).items():
            config.insert_json5(name, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as cause:
        raise SessionError(f"no session of Zenoh: {_short(cause)}") from cause


def _settings(link: Link) -> dict[str, Any]:
    tls = link.tls
    found = {
        "mode": link.mode,
        "connect/endpoints": list(link.connect),
        "connect/timeout_ms": -1,  # for ever: a router that is away is found when it is back
        "connect/exit_on_failure": False,
        "listen/endpoints": list(link.listen),
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        "timestamping/enabled": True,
        "transport/link/protocols": ["tcp" if tls is None else "tls"],
        "transport/link/rx/max_message_size": link.max_message_bytes,
        "access_control": _access(tls),
    }
    if tls is not None:
        found["transport/link/tls"] = {
            "root_ca_certificate": str(tls.ca),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "listen_certificate": str(tls.certificate),
            "listen_private_key": str(tls.key),
            "connect_certificate": str(tls.certificate),
            "connect_private_key": str(tls.key),
            "close_link_on_expiration": True,
        }
    return found


def _access(tls: Tls | None) -> dict[str, Any]:
    """Nobody may say anything, but this machine, or those whom a certificate names.

    Peers tell each other of further peers, wherever these are: what is not allowed here is not heard from them.
    """
    subject: dict[str, Any] = {"id": "known"}
    if tls is None:
        subject |= {"interfaces": ["lo"], "link_protocols": ["tcp"]}
    else:
        subject |= {"link_protocols": ["tls"]}
        if tls.names:
            subject |= {"cert_common_names": list(tls.names)}
    rule = {
        "id": "all",
        "messages": list(_ALL),
        "flows": ["ingress", "egress"],
        "permission": "allow",
        "key_exprs": ["**", "@ros2_lv/**", "**/@adv/**", "@/**"],
    }
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule],
        "subjects": [subject],
        "policies": [{"rules": ["all"], "subjects": ["known"]}],
    }


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _short(cause: Exception) -> str:
    """Zenoh's own words without the places in its source."""
    return re.sub(r" at [^ ]*\.rs:\d+\.?", "", str(cause)).strip()[:400]
