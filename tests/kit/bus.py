"""Organisations with their authorities, and who is on the bus with certificates of theirs."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from wonderland_bus.settings import Member, Router, Tls
from wonderland_fabric_gateway.ca.local import Kind, LocalCa

HOST = "localhost"


class Organisations:
    """AuthorityMSP and PadMSP, both trusted on the bus; more by `add`, in `trusted` or not."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.ca = directory / "bus-ca.pem"
        """Of the router: whom it lets in."""
        self.authority_ca = directory / "authority-ca.pem"
        """Of agents: router and backend are of the authority."""
        self._authorities: dict[str, LocalCa] = {}
        self.trust("AuthorityMSP", "PadMSP")
        self.authority_ca.write_bytes(self.add("AuthorityMSP").root_pem(Kind.TLS))

    def add(self, msp_id: str) -> LocalCa:
        """An organisation's authority."""
        if msp_id not in self._authorities:
            self._authorities[msp_id] = LocalCa.create(self.directory / msp_id, msp_id)
        return self._authorities[msp_id]

    def trust(self, *msp_ids: str) -> None:
        """Whose certificates the bus accepts."""
        roots = [self.add(msp_id).root_pem(kind) for msp_id in msp_ids for kind in Kind]
        self.ca.write_bytes(b"".join(roots))

    def tls(self, msp_id: str, name: str, *, kind: Kind = Kind.IDENTITY, hosts: Sequence[str] = ()) -> Tls:
        """A certificate of this name; the authority's servers believe who is trusted, agents the authority."""
        files = self.directory / "issued" / msp_id / kind
        if not (files / f"{name}.pem").exists():
            role = {"pol.role": "pad", "pol.id": name} if kind is Kind.IDENTITY and name.startswith("pad") else {}
            self.add(msp_id).enrol(name, kind=kind, hosts=hosts, attributes=role).write(files)
        ca = self.ca if kind is Kind.TLS else self.authority_ca
        return Tls(ca=ca, certificate=files / f"{name}.pem", key=files / f"{name}.key")

    def expired(self, msp_id: str, name: str) -> Tls:
        """A certificate of yesterday."""
        files = self.directory / "expired"
        self.add(msp_id)
        yesterday = datetime.now(UTC) - timedelta(days=1)
        before = LocalCa.create(self.directory / f"{msp_id}-before", msp_id, now=lambda: yesterday)
        before.enrol(name, validity=timedelta(hours=1)).write(files)
        with self.ca.open("ab") as file:
            file.write(before.root_pem())
        return Tls(ca=self.ca, certificate=files / f"{name}.pem", key=files / f"{name}.key")

    def router(self, port: int, *, agents: Sequence[str] = ("pad-1", "pad-2")) -> Router:
        """Settings of a router for these organisations."""
        return Router(
            tls=self.tls("AuthorityMSP", "router", kind=Kind.TLS, hosts=[HOST]),
            agents=agents,
            backends=("backend-1", "backend-2"),
            listen=[f"tls/{HOST}:{port}"],
        )

    def member(self, msp_id: str, name: str, port: int) -> Member:
        """Settings of a session that goes to that router."""
        return Member(routers=[f"tls/{HOST}:{port}"], tls=self.tls(msp_id, name), patience_ms=1_000)


def free_port() -> int:
    """A port that nobody has just now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
