"""What an applicant asks a CA for, and what of it a CA certifies."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass, field
from datetime import timedelta
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from wonderland_fabric_gateway.attributes import encode_attributes
from wonderland_fabric_gateway.ca.errors import CaRequestError
from wonderland_fabric_gateway.errors import IdentityError
from wonderland_fabric_gateway.identity import NODE_OUS

if TYPE_CHECKING:
    from collections.abc import Mapping

VALIDITY: Final = timedelta(days=365)
MIN_VALIDITY: Final = timedelta(seconds=1)
MAX_VALIDITY: Final = timedelta(days=5 * 365)
MAX_HOSTS: Final = 100

_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._@:-]{0,63}")  # 64: ub-common-name of X.520
_LABEL: Final = re.compile(r"[A-Za-z0-9]([A-Za-z0-9-]{0,61}[A-Za-z0-9])?")


class Kind(StrEnum):
    """What a certificate is for. Each kind has its own root, so that a TLS key can sign no transaction."""

    IDENTITY = "identity"
    TLS = "tls"


@dataclass(frozen=True, slots=True)
class Application:
    """A name, what it is in its organisation (node OU), its attributes, hosts for TLS, and for how long."""

    name: str
    node_ou: str = "client"
    attributes: Mapping[str, str] = field(default_factory=dict)
    kind: Kind = Kind.IDENTITY
    hosts: tuple[str, ...] = ()
    validity: timedelta = VALIDITY

    def check(self) -> None:
        """Raise `CaRequestError`, naming what is wrong, unless a certificate can say all this."""
        if not _NAME.fullmatch(self.name):
            raise CaRequestError(f"name {self.name!r}: a letter or digit, then up to 63 letters, digits and . _ @ : -")
        if self.node_ou not in NODE_OUS:
            raise CaRequestError(f"node OU {self.node_ou!r} is none of {', '.join(sorted(NODE_OUS))}")
        if not MIN_VALIDITY <= self.validity <= MAX_VALIDITY:
            raise CaRequestError(f"a lifetime of {self.validity}; {MIN_VALIDITY} to {MAX_VALIDITY} can be had")
        if self.kind is Kind.TLS and self.attributes:
            raise CaRequestError("a TLS certificate carries no attributes; they belong to the identity's")
        if len(self.hosts) > MAX_HOSTS:
            raise CaRequestError(f"{len(self.hosts)} hosts; a certificate names at most {MAX_HOSTS}")
        for host in self.hosts:
            if not is_address(host) and not _is_host_name(host):
                raise CaRequestError(f"host {host!r} is neither an IP address nor a host name")
        try:
            encode_attributes(self.attributes)
        except IdentityError as cause:
            raise CaRequestError(str(cause)) from cause


def is_address(host: str) -> bool:
    """Whether a host is an IPv4 or IPv6 address."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


def _is_host_name(host: str) -> bool:
    labels = host.removeprefix("*.").split(".")
    return len(host) <= 253 and all(_LABEL.fullmatch(label) for label in labels)
