"""Settings of the audit log's stream."""

from __future__ import annotations

from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, model_validator

_PORTS = {"syslog": 514, "syslog+tcp": 601, "syslog+tls": 6514}


class AuditStreamSettings(BaseModel):
    """Where the audit log is sent as it grows."""

    model_config = ConfigDict(extra="forbid")

    to: str = Field(
        max_length=256,
        description="file:///var/log/wonderland/audit.jsonl, syslog://host:514, syslog+tcp://…, syslog+tls://…",
    )
    tls_ca: Path | None = Field(default=None, description="CA of the syslog server's certificate (PEM)")

    @property
    def default_port(self) -> int:
        """Of the scheme (RFC 5426, 6587, 5425)."""
        return _PORTS[urlsplit(self.to).scheme]

    @model_validator(mode="after")
    def _is_a_destination(self) -> Self:
        url = urlsplit(self.to)
        try:
            server = url.scheme in _PORTS and bool(url.hostname) and url.port != 0
        except ValueError:
            server = False
        if not server and not (url.scheme == "file" and url.path):
            raise ValueError(f"audit_stream.to: {self.to!r} is none of file:///path, {', '.join(_PORTS)} with ://host")
        if self.tls_ca is not None and url.scheme != "syslog+tls":
            raise ValueError("audit_stream.tls_ca goes with syslog+tls:// only")
        return self
