"""Sessions of Zenoh as the bus has them: mutual TLS, no multicast, no gossip, nobody listens but the router.

    member = Member(routers=["tls/router.example:7447"], tls=Tls(ca=…, certificate=…, key=…))
    session = open_member(member)              # blocks; not in asyncio's thread
    session.put("wonderland/backends/live/track", b"…", congestion_control=zenoh.CongestionControl.DROP)
    session.declare_subscriber("wonderland/backends/**", zenoh.handlers.Callback(heard, indirect=False))

A backend may put, subscribe, query, answer and hold liveliness tokens below ``wonderland/backends/`` (`keys.BACKENDS`),
where its certificate's common name is among the router's ``backends``; agents may do nothing there. What is not allowed
is dropped by the router without a word. Mind what Zenoh does not promise:

- ``put`` never fails: while a router is away, what is put is lost. Number what you say, and see gaps.
- A peer that hangs is noticed after ``lease_ms``. Liveliness says that a link stands, not that anybody works.
- Callbacks run in Zenoh's threads: ``loop.call_soon_threadsafe``, a bounded queue, nothing slow.
- The router knows names, not issuers, of whatever authority its ``ca`` file has (docs/decisions/0044). What must not
  be forged by another of these authorities has to be signed or to run in a `wonderland_bus.channel`.

``links_changed(session, …)`` tells when the router was lost or found.
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable
from typing import Any

import zenoh

from wonderland_bus.access import control, few_openings
from wonderland_bus.errors import BusError, BusUnreachableError
from wonderland_bus.handshake import refusals
from wonderland_bus.settings import MAX_MESSAGE_BYTES, Member, Router, Tls


def open_member(member: Member) -> zenoh.Session:
    """The session of an agent or a backend. It outlives its router, and finds it again or another of `member.routers`.

    Raises `BusUnreachableError` where none lets it in within `Member.patience_ms`, `BusSettingsError`.
    """
    member.check()
    late_s = time.monotonic() + member.patience_ms / 1000
    while True:
        try:
            return _open(_member_settings(member))
        except BusError as cause:
            if time.monotonic() > late_s:
                raise BusUnreachableError("; ".join(refusals(member)) or str(cause)) from cause
        time.sleep(member.retry_ms / 1000)


def _member_settings(member: Member) -> dict[str, Any]:
    return _common(member.tls, member.lease_ms) | {
        "mode": "client",  # a router passes nothing from one peer to another: these have to meet by themselves
        "connect/endpoints": list(member.routers),
        "connect/timeout_ms": 0,  # each router once: with a time, Zenoh spends all of it on the first
        "connect/exit_on_failure": True,
        "connect/retry": {
            "period_init_ms": member.retry_ms,
            "period_max_ms": 16 * member.retry_ms,
            "period_increase_factor": 2,
        },
        "listen/endpoints": [],
    }


def open_router(router: Router) -> zenoh.Session:
    """A router, for as long as the session stands. Raises `BusError`."""
    router.check()
    return _open(
        _common(router.tls, router.lease_ms)
        | {
            "mode": "router",
            "listen/endpoints": list(router.listen),
            "listen/exit_on_failure": True,
            "connect/endpoints": [],
            "transport/unicast/max_sessions": router.max_peers,
            "access_control": control(router.agents, router.backends),
            "downsampling": few_openings(),
        }
    )


def links_changed(session: zenoh.Session, tell: Callable[[bool], object]) -> Any:
    """``tell(True)`` when a router was found, ``tell(False)`` when it was lost; in a thread of Zenoh's.

    Keep what is returned for as long as it is to be told.
    """

    def changed(event: zenoh.TransportEvent) -> None:
        tell(event.kind == zenoh.SampleKind.PUT)

    return session.info.declare_transport_events_listener(
        zenoh.handlers.Callback(changed, indirect=False), history=True
    )


def _common(tls: Tls, lease_ms: int) -> dict[str, Any]:
    return {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "adminspace/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/protocols": ["tls"],
        "transport/link/tx/lease": lease_ms,
        "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES,
        "transport/link/tls": {
            "root_ca_certificate": str(tls.ca),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "listen_certificate": str(tls.certificate),
            "listen_private_key": str(tls.key),
            "connect_certificate": str(tls.certificate),
            "connect_private_key": str(tls.key),
            "close_link_on_expiration": True,
        },
    }


def _open(settings: dict[str, Any]) -> zenoh.Session:
    config = zenoh.Config()
    try:
        for name, value in settings.items():
            config.insert_json5(name, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as cause:
        raise BusError(f"no session of Zenoh: {_short(cause)}") from cause


def _short(cause: Exception) -> str:
    """Zenoh's own words without the places in its source."""
    return re.sub(r" at [^ ]*\.rs:\d+\.?", "", str(cause)).strip()[:400]
