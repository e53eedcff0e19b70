"""Settings: defaults here, then a TOML file, the environment (``WONDERLAND_BACKEND_…``) and options; the last wins."""

from __future__ import annotations

import os
from ipaddress import ip_network
from pathlib import Path
from tomllib import TOMLDecodeError
from typing import Final, Literal, Self

from pydantic import Field, IPvAnyNetwork, ValidationError, model_validator
from pydantic_settings import BaseSettings, PydanticBaseSettingsSource, SettingsConfigDict, TomlConfigSettingsSource
from pydantic_settings import SettingsError as UnreadableError

from wonderland.messages import Language
from wonderland_backend.errors import SettingsError
from wonderland_backend.field_texts import field_text
from wonderland_backend.settings.agents import AgentSettings
from wonderland_backend.settings.audit import AuditStreamSettings
from wonderland_backend.settings.bus import BusSettings
from wonderland_backend.settings.maps import MapSettings
from wonderland_backend.settings.oidc import OidcSettings
from wonderland_backend.settings.outputs import OutputSettings
from wonderland_backend.settings.uspace import USpaceSettings

PREFIX: Final = "WONDERLAND_BACKEND_"
CONFIG: Final = PREFIX + "CONFIG"
"""Names the TOML file; `wonderland backend --config` sets it."""
MIN_TOKEN: Final = 16


class Settings(BaseSettings):
    """Everything that an operator can set."""

    model_config = SettingsConfigDict(env_prefix=PREFIX, env_nested_delimiter="__", extra="forbid", frozen=True)

    @classmethod
    def settings_customise_sources(
        cls, settings_cls: type[BaseSettings], *sources: PydanticBaseSettingsSource, **named: PydanticBaseSettingsSource
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Options, then the environment, then the file."""
        file = os.environ.get(CONFIG)
        first = (named["init_settings"], named["env_settings"])
        return (*sources, *first, TomlConfigSettingsSource(settings_cls, Path(file))) if file else (*sources, *first)

    listen: str = Field(default="127.0.0.1:8080", description="HOST:PORT; port 0: any free one")
    database: str = Field(default="sqlite:///wonderland.db", description="sqlite:///file or postgresql://…")
    connection: Path | None = Field(default=None, description="connection.json of the ledger")
    identity: str = Field(default="mirror", description="Which identity of connection.json reads the blocks")
    trust: Path | None = Field(
        default=None,
        description="TRUST.json (wonderland evidence trust) that was compared with another organisation's: its channel",
    )
    console: Path | None = Field(default=None, description="Directory with the built console")
    public_url: str | None = Field(
        default=None, pattern=r"https?://[^/\s]+/?", description="The address that people use, behind a proxy"
    )
    tls_certificate: Path | None = Field(
        default=None, description="This server's certificate chain (PEM), where no proxy ends TLS before it"
    )
    tls_key: Path | None = Field(default=None, description="Its private key (PEM), if it is not in the same file")
    tls_client_ca: Path | None = Field(
        default=None, description="CAs (PEM) of the certificates that machines may show (RFC 8705)"
    )
    client_cert_proxies: tuple[str, ...] = Field(
        default=(), description="Addresses or networks of proxies whose Client-Cert header (RFC 9440) is believed"
    )
    plaintext: bool = Field(
        default=False, description="Other machines may reach it by http: inside a network that is protected otherwise"
    )
    demo: bool = Field(default=False, description="Says so in the console; only on loopback")

    token_ttl_s: int = Field(default=900, ge=10, le=86_400, description="How long a one-time token is good")
    invitation_ttl_s: int = Field(default=7 * 86_400, ge=60, le=30 * 86_400, description="How long an invitation is")
    sign_in_attempts: int = Field(default=60, ge=5, description="Attempts to sign in a minute, from one address")
    sign_in_ttl_s: int = Field(default=12 * 3600, ge=60, le=30 * 86_400, description="How long a sign-in lasts")
    sign_in_idle_s: int = Field(default=4 * 3600, ge=60, le=30 * 86_400, description="Unused, it ends after this")
    display_ttl_s: int = Field(default=30 * 86_400, ge=60, le=366 * 86_400, description="How long a display's lasts")
    metrics_token: str | None = Field(default=None, min_length=16, description="Bearer token for /metrics")
    metrics_token_file: Path | None = Field(default=None, description="A file with it, read when it is asked for")

    signed_per_minute: int = Field(default=600, ge=1, description="Transactions that one person may begin a minute")
    demo_registrar: Path | None = Field(
        default=None, description="A ledger's directory: the demo gives roles on it at a click; only with --demo"
    )

    max_connections: int = Field(default=10_000, ge=1, description="Most connections at a time")
    max_connections_each: int = Field(
        default=256, ge=1, description="Most of one address; trusted proxies and this machine keep their own limits"
    )
    trusted_proxies: tuple[IPvAnyNetwork, ...] = Field(
        default=(ip_network("127.0.0.1"), ip_network("::1")),
        description="Addresses and networks whose X-Forwarded-For and -Proto are believed",
    )

    max_body_bytes: int = Field(default=64 * 1024, ge=1024, description="Largest body of a request")
    max_zone_file_bytes: int = Field(default=32 << 20, ge=1024, description="Largest file of zones")
    agents: AgentSettings = Field(default=AgentSettings(), description="Where agents sign in; see docs/operate/edge.md")
    bus: BusSettings | None = Field(
        default=None, description="A bus of Zenoh for agents (docs/operate/bus.md) and among backends (standby.md)"
    )
    ingest_max_bytes: int = Field(default=256 * 1024, ge=1024, description="Largest frame of an agent")
    ingest_max_records: int = Field(default=1_000, ge=1, description="Most records in one frame of an agent")
    ingest_max_agents: int = Field(default=5_000, ge=1, description="Most agents connected at a time")

    tick_ms: int = Field(default=100, ge=20, le=5_000, description="Period of the live interface")
    ring_bytes: int = Field(default=16 << 20, ge=0, description="Live frames kept for clients that come back")
    client_queue_bytes: int = Field(default=4 << 20, ge=1024, description="A client further behind is closed")
    max_viewers: int = Field(default=2_000, ge=1, description="Most live connections at a time")

    alert_emails: tuple[str, ...] = Field(default=(), description="Who is told by e-mail: mailto:name@host, …")
    alert_webhooks: tuple[str, ...] = Field(default=(), description="Who is told by webhook: https://…, …")
    alert_severity: Literal["critical", "warning", "notice"] = Field(
        default="warning", description="The least grave alert that is told outside"
    )
    alert_language: Language = Field(default="en", description="In which language e-mails and webhooks are written")
    alert_webhook_secret: str | None = Field(default=None, min_length=32, description="Signs webhooks (HMAC-SHA256)")
    smtp: str | None = Field(
        default=None, pattern=r"(smtp|smtps|smtp\+starttls)://\S+", description="smtp+starttls://user@host:587"
    )
    smtp_from: str | None = Field(default=None, description="Sender of e-mails")
    smtp_password: str | None = Field(default=None, description="Best given by the environment")

    token_key_file: Path | None = Field(
        default=None,
        description="P-256 keys (PEM) that sign machines' tokens, the signing one first; without it, new at each start",
    )
    webhook_allowed_hosts: tuple[str, ...] = Field(
        default=(), description="Hosts at private addresses, or by http, that webhooks may go to all the same"
    )
    outbound_hosts: tuple[str, ...] = Field(
        default=(),
        max_length=256,
        description="The only hosts that webhooks, and systems that a DSS names, may be at; .example.com: all below it",
    )
    webhook_key_file: Path | None = Field(
        default=None,
        description="Key that encrypts webhooks' secrets, made where it is missing; by itself beside a SQLite database",
    )
    webhook_ca_file: Path | None = Field(default=None, description="Further CAs (PEM) of receivers' certificates")
    max_event_streams: int = Field(default=1_000, ge=1, description="Most event streams (SSE) at a time")
    max_event_streams_each: int = Field(default=10, ge=1, description="Most of one person or machine")
    client_requests_per_min: int = Field(default=600, ge=1, description="Requests of one machine in a minute")
    person_requests_per_min: int = Field(
        default=3_000, ge=1, description="Requests of one signed-in person in a minute"
    )
    client_exports_per_min: int = Field(default=6, ge=1, description="Exports that one machine may prepare in a minute")

    track_retention_h: float = Field(
        default=24 * 7, gt=0, description="How long unverified positions are kept (PostgreSQL: and to that day's end)"
    )
    estimate_retention_h: float = Field(default=24 * 30, gt=0, description="The same for pads' running estimates")
    health_retention_h: float = Field(default=24 * 7, gt=0, description="The same for pads' health and connections")
    finding_retention_h: float = Field(default=24 * 30, gt=0, description="The same for findings and refused records")
    export_max_rows: int = Field(default=2_000_000, ge=1, description="Most rows of one export")
    mirror_batch_transactions: int = Field(default=2_000, ge=1, description="Most transactions in one commit")
    row_check_transactions_per_s: int = Field(
        default=200, ge=0, description="How fast rows are derived anew to be compared with the ledger; 0: never"
    )
    log_level: Literal["debug", "info", "warning", "error"] = Field(default="info", description="What the log has")

    audit_identity: str | None = Field(
        default=None, description="Which identity of connection.json anchors the audit log on the ledger"
    )
    timestamp_url: str | None = Field(
        default=None, pattern=r"^https?://[^/\s]+(/\S*)?$", description="RFC 3161 service that stamps evidence"
    )
    audit_anchor_s: int = Field(default=300, ge=1, le=86_400, description="How often, where there is something new")
    audit_stream: AuditStreamSettings | None = Field(
        default=None, description="Where it is sent as it grows; see docs/operate/people.md"
    )
    oidc: OidcSettings = Field(default=OidcSettings(), description="OpenID provider; see docs/operate/people.md")
    map: MapSettings = Field(default=MapSettings(), description="Base maps; see docs/operate/map.md")
    outputs: OutputSettings = Field(
        default=OutputSettings(), description="TAK, MQTT, live GeoJSON, exports; see docs/outputs.md"
    )
    uspace: USpaceSettings = Field(default=USpaceSettings(), description="U-space; see docs/uspace/settings.md")

    @model_validator(mode="after")
    def _alerts_can_be_told(self) -> Self:
        for address in self.alert_emails:
            if not address.startswith("mailto:") or "@" not in address or len(address) > 300:
                raise ValueError(f"alert_emails: {address!r} is not mailto:name@host")
        for url in self.alert_webhooks:
            if not url.startswith(("https://", "http://127.0.0.1", "http://localhost")) or len(url) > 500:
                raise ValueError("alert_webhooks: https:// addresses only (http:// on this machine alone)")
        if self.alert_emails and self.smtp is None:
            raise ValueError("alert_emails need smtp: say which server sends them")
        if self.alert_webhooks and self.alert_webhook_secret is None:
            raise ValueError("alert_webhooks need alert_webhook_secret: receivers must know who speaks")
        return self

    @model_validator(mode="after")
    def _tls_fits(self) -> Self:
        if self.tls_certificate is not None and not self.is_https:
            raise ValueError("tls_certificate needs public_url: the https:// address that the certificate is for")
        if self.tls_certificate is None and self.tls_key is not None:
            raise ValueError("tls_key needs tls_certificate")
        if self.agents.listen is not None and self.agents.tls_certificate is None and self.tls_certificate is None:
            raise ValueError("agents.listen needs agents.tls_certificate: agents' own listener is TLS")
        if self.agents.tls_key is not None and self.agents.tls_certificate is None:
            raise ValueError("agents.tls_key needs agents.tls_certificate")
        if self.tls_client_ca is not None and self.tls_certificate is None and not self.client_cert_proxies:
            raise ValueError("tls_client_ca needs tls_certificate or client_cert_proxies: who else asks for them?")
        for each in self.client_cert_proxies:
            try:
                network = ip_network(each)
            except ValueError:
                raise ValueError(f"client_cert_proxies: {each!r} is no address or network") from None
            if not network.prefixlen:
                raise ValueError("client_cert_proxies: everybody is no proxy; name the addresses of yours")
        return self

    def metrics_bearer(self) -> str | None:
        """The token that opens /metrics; None where nobody has set one, or its file cannot be read."""
        if self.metrics_token_file is None:
            return self.metrics_token
        try:
            token = self.metrics_token_file.read_text().strip()
        except (OSError, UnicodeDecodeError):
            return None
        return token if len(token) >= MIN_TOKEN else None

    @property
    def is_https(self) -> bool:
        """Whether people reach this server by https."""
        return self.public_url is not None and self.public_url.startswith("https:")


def load(**options: object) -> Settings:
    """From the file, the environment and these options; those that are None do not count. Raises `SettingsError`."""
    file = os.environ.get(CONFIG)
    if file and not Path(file).is_file():
        raise SettingsError(f"--config: there is no file {file}, or {CONFIG} should not be set")
    try:
        return Settings(**{name: value for name, value in options.items() if value is not None})  # type: ignore[arg-type]
    except UnreadableError as cause:
        raise SettingsError(f"{cause}: lists and objects are written as JSON") from None
    except (OSError, TOMLDecodeError, UnicodeDecodeError) as cause:
        raise SettingsError(f"--config: {file} cannot be read ({cause})") from None
    except ValidationError as cause:
        first = cause.errors()[0]
        name = ".".join(str(part) for part in first["loc"])
        variable = PREFIX + "__".join(str(part) for part in first["loc"]).upper()
        raise SettingsError(f"{name} (environment: {variable}): {field_text(first)}") from None
