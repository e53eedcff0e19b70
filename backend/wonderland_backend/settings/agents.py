"""Where agents sign in."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field


class AgentSettings(BaseModel):
    """``WONDERLAND_BACKEND_AGENTS__…``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    listen: str | None = Field(
        default=None, description="HOST:PORT for agents alone, and they nowhere else: TLS by their ledger certificates"
    )
    tls_certificate: Path | None = Field(
        default=None, description="Certificate chain (PEM) of this listener, if it is not tls_certificate"
    )
    tls_key: Path | None = Field(default=None, description="Its private key (PEM), if it is not in the same file")
    proxy_certificates: tuple[Path, ...] = Field(
        default=(),
        description="Certificates (PEM) that proxies which end TLS show agents: an agent signs in to what it saw",
    )
    records_per_s: int = Field(
        default=5_000, ge=1, description="Records of one agent in a second, of 512 bytes; what is more waits"
    )
