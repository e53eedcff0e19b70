"""The bus of Zenoh, where this backend meets agents and other backends."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field


class BusSettings(BaseModel):
    """``WONDERLAND_BACKEND_BUS__…``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    routers: tuple[str, ...] = Field(
        min_length=1, description="Its routers, tls/HOST:PORT each: this backend is with the first that answers"
    )
    ca: Path = Field(description="The authorities (PEM) that issue the routers’ certificates")
    certificate: Path = Field(
        description="This backend’s certificate chain (PEM): its common name is among the routers’ backends, and the "
        "name that agents’ addresses end with is among its hosts"
    )
    key: Path = Field(description="Its private key (PEM)")
