"""Settings: defaults here, overridden by the environment (``WONDERLAND_BACKEND_…``), then by options."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal, Self

from pydantic import Field, ValidationError, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from backend.errors import SettingsError

PREFIX: Final = "WONDERLAND_BACKEND_"
MIN_TOKEN: Final = 16


class Settings(BaseSettings):
    """Everything that an operator can set."""

    model_config = SettingsConfigDict(env_prefix=PREFIX, extra="forbid", frozen=True)

    database: str = Field(default="sqlite:///wonderland.db", description="sqlite:///file or postgresql://…")
    connection: Path | None = Field(default=None, description="connection.json of the ledger")
    identity: str = Field(default="mirror", description="Which identity of connection.json reads the blocks")
    console: Path | None = Field(default=None, description="Directory with the built console")
    public_url: str | None = Field(
        default=None, pattern=r"https?://[^/\s]+/?", description="The address that people use, behind a proxy"
    )
    demo: bool = Field(default=False, description="Says so in the console; only on loopback")

    token_ttl_s: int = Field(default=900, ge=10, le=86_400, description="How long a one-time token is good")
    sign_in_ttl_s: int = Field(default=12 * 3600, ge=60, le=30 * 86_400, description="How long a sign-in lasts")
    sign_in_idle_s: int = Field(default=4 * 3600, ge=60, le=30 * 86_400, description="Unused, it ends after this")
    metrics_token: str | None = Field(default=None, min_length=16, description="Bearer token for /metrics")
    metrics_token_file: Path | None = Field(default=None, description="A file with it, read when it is asked for")

    max_body_bytes: int = Field(default=64 * 1024, ge=1024, description="Largest body of a request")
    ingest_max_bytes: int = Field(default=256 * 1024, ge=1024, description="Largest frame of an agent")
    ingest_max_records: int = Field(default=1_000, ge=1, description="Most records in one frame of an agent")
    ingest_max_agents: int = Field(default=5_000, ge=1, description="Most agents connected at a time")

    tick_ms: int = Field(default=200, ge=20, le=5_000, description="Period of the live interface")
    ring_bytes: int = Field(default=16 << 20, ge=0, description="Live frames kept for clients that come back")
    client_queue_bytes: int = Field(default=4 << 20, ge=1024, description="A client further behind is closed")
    max_viewers: int = Field(default=2_000, ge=1, description="Most live connections at a time")

    alert_emails: tuple[str, ...] = Field(default=(), description="Who is told by e-mail: mailto:name@host, …")
    alert_webhooks: tuple[str, ...] = Field(default=(), description="Who is told by webhook: https://…, …")
    alert_severity: Literal["critical", "warning", "notice"] = Field(
        default="warning", description="The least grave alert that is told outside"
    )
    alert_webhook_secret: str | None = Field(default=None, min_length=32, description="Signs webhooks (HMAC-SHA256)")
    smtp: str | None = Field(
        default=None, pattern=r"(smtp|smtps|smtp\+starttls)://\S+", description="smtp+starttls://user@host:587"
    )
    smtp_from: str | None = Field(default=None, description="Sender of e-mails")
    smtp_password: str | None = Field(default=None, description="Best given by the environment")

    track_retention_h: float = Field(default=24 * 7, gt=0, description="How long unverified positions are kept")
    mirror_batch_transactions: int = Field(default=2_000, ge=1, description="Most transactions in one commit")
    log_level: Literal["debug", "info", "warning", "error"] = "info"

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
    """Settings from the environment and these options; those that are None do not count. Raises `SettingsError`."""
    try:
        return Settings(**{name: value for name, value in options.items() if value is not None})  # type: ignore[arg-type]
    except ValidationError as cause:
        first = cause.errors()[0]
        name = ".".join(str(part) for part in first["loc"])
        raise SettingsError(f"{name} (environment: {PREFIX}{name.upper()}): {first['msg']}") from None
