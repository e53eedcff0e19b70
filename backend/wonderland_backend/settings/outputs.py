"""Settings of the outputs, in the environment as ``WONDERLAND_BACKEND_OUTPUTS__…``.

What is sent (TAK, MQTT) is on where it is set; what is fetched (live GeoJSON, exports) is on until it is switched off.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, model_validator

Kind = Literal["claim", "estimate", "verdict"]
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
Format = Literal["geojson", "csv", "mfjson"]
FORMATS: Final[tuple[Format, ...]] = get_args(Format)
"""Of exports."""
_HOST: Final = r"[^/\s@?#:]+|\[[0-9A-Fa-f:.]+\]"


class _Output(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    tell: frozenset[Kind] = Field(
        default=frozenset(KINDS), min_length=1, description="Which of claim, estimate, verdict"
    )
    period_ms: int = Field(default=1_000, ge=0, le=3_600_000, description="A drone's positions at most this often")


class TakSettings(_Output):
    """A TAK server, or a group of TAK clients, that gets Cursor-on-Target events."""

    url: str = Field(
        pattern=rf"^(tcp|tls|udp)://({_HOST}):[0-9]{{1,5}}$",
        description="tls://takserver.example:8089, udp://239.2.3.1:6969",
    )
    tls_certificate: Path | None = Field(default=None, description="Client certificate (PEM) for tls")
    tls_key: Path | None = Field(default=None, description="Its key (PEM), unencrypted")
    tls_ca: Path | None = Field(default=None, description="CA of the server's certificate (PEM)")

    @model_validator(mode="after")
    def _tls_is_whole(self) -> Self:
        files = (self.tls_certificate, self.tls_key, self.tls_ca)
        if self.url.startswith("tls:") and None in files:
            raise ValueError("tls needs tls_certificate, tls_key and tls_ca: TAK servers know their clients by them")
        if not self.url.startswith("tls:") and any(files):
            raise ValueError("certificates go with tls:// only")
        return self


class MqttSettings(_Output):
    """An MQTT broker."""

    host: str = Field(pattern=f"^({_HOST})$", description="The broker")
    port: int = Field(default=8883, ge=1, le=65_535, description="Its port")
    protocol: Literal["5", "3.1.1"] = Field(default="5", description="3.1.1 for brokers that know no MQTT 5")
    tls: bool = Field(default=True, description="Off only on a network of one's own")
    tls_ca: Path | None = Field(default=None, description="CA of the broker's certificate (PEM); else the system's CAs")
    username: str | None = Field(default=None, min_length=1, max_length=256, description="As whom to sign in")
    password_file: Path | None = Field(default=None, description="A file with the password, read at the start")
    prefix: str = Field(
        default="wonderland",
        pattern=r"^[A-Za-z0-9._-]+(/[A-Za-z0-9._-]+){0,8}$",
        max_length=128,
        description="Where topics begin",
    )


class OutputSettings(BaseModel):
    """All outputs."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    tak: TakSettings | None = None
    mqtt: MqttSettings | None = None
    live_geojson: bool = Field(default=True, description="Whether /api/v1/picture answers")
    exports: frozenset[Format] = Field(
        default=frozenset(FORMATS), description="Formats in which windows of the past can be had; [] for none"
    )

    def switches(self) -> dict[str, Any]:
        """Which outputs are on, as the status tells it."""
        return {
            "tak": self.tak is not None,
            "mqtt": self.mqtt is not None,
            "live_geojson": self.live_geojson,
            "exports": [each for each in FORMATS if each in self.exports],
        }
