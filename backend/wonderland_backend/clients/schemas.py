"""Shapes of OAuth clients and of tokens."""

from __future__ import annotations

from typing import Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from wonderland.problems import said
from wonderland_backend.clients.store import ByCertificate, ClientError, Role
from wonderland_backend.schemas import ApiModel, page_of

NAMES: Final[tuple[Literal["subject_dn", "san_dns", "san_uri"], ...]] = ("subject_dn", "san_dns", "san_uri")


class CertificateName(ApiModel):
    """What a client's certificate is known by: one of its names, if one of our client CAs issued it, or its hash."""

    subject_dn: str | None = Field(default=None, description="RFC 4514, such as CN=machine,O=City,C=FI")
    san_dns: str | None = None
    san_uri: str | None = None
    sha256: str | None = Field(default=None, description="Of the certificate itself (DER), hexadecimal")


class NewCertificate(BaseModel):
    """One of these: a name in certificates of our client CAs, or the certificate itself."""

    model_config = ConfigDict(extra="forbid")

    subject_dn: str | None = Field(default=None, max_length=500)
    san_dns: str | None = Field(default=None, max_length=500)
    san_uri: str | None = Field(default=None, max_length=500)
    pem: str | None = Field(default=None, max_length=20_000, description="The certificate itself, self-signed or not")

    def known_by(self) -> ByCertificate:
        """The certificate by which the client will be known. Raises `ClientError`."""
        given = [(kind, value) for kind in NAMES if (value := getattr(self, kind)) is not None]
        if len(given) + (self.pem is not None) != 1:
            raise ClientError(said("client_certificate_one"))
        if self.pem is not None:
            return ByCertificate.pinned(self.pem)
        return ByCertificate.named(*given[0])


class RegisteredClient(ApiModel):
    """A machine that may read the API."""

    client_id: str
    name: str
    scopes: list[str] = Field(description="Those it may ask for")
    role: Role = Field(description="What it sees: viewer no personal data, inspector all, the others their own")
    msp_id: str | None = Field(default=None, description="The organisation whose pads or drones it sees")
    method: Literal["client_secret_basic", "private_key_jwt", "tls_client_auth", "self_signed_tls_client_auth"]
    certificate: CertificateName | None = Field(default=None, description="How its certificate is known")
    created_ms: int
    created_by: str
    revoked_ms: int | None = None
    last_token_ms: int | None = Field(default=None, description="When it last got a token")


class TokenKeys(ApiModel):
    """A JWK set (RFC 7517)."""

    keys: list[dict[str, Any]] = Field(
        examples=[
            [
                {
                    "kty": "EC",
                    "crv": "P-256",
                    "x": "f83OJ3D2xF1Bg8vub9tLe1gHMzV76e8Tus9uPHvRVEU",
                    "y": "x_FEzRu9m36HLN_tue659LNpXW6pCyStikYjKIWI5a0",
                    "kid": "5d0c2f6b9a7e4c1d",
                    "use": "sig",
                    "alg": "ES256",
                }
            ]
        ]
    )


class AuthorizationServer(ApiModel):
    """Metadata of an authorization server (RFC 8414)."""

    issuer: str = Field(examples=["https://wonderland.example.com"])
    token_endpoint: str = Field(examples=["https://wonderland.example.com/oauth/token"])
    jwks_uri: str = Field(examples=["https://wonderland.example.com/oauth/jwks.json"])
    scopes_supported: list[str] = Field(examples=[["wonderland.proofs.read", "rid.display_provider"]])
    response_types_supported: list[str] = Field(examples=[[]])
    grant_types_supported: list[str] = Field(examples=[["client_credentials"]])
    token_endpoint_auth_methods_supported: list[str] = Field(examples=[["client_secret_basic", "private_key_jwt"]])
    token_endpoint_auth_signing_alg_values_supported: list[str] = Field(examples=[["ES256", "RS256", "PS256"]])
    tls_client_certificate_bound_access_tokens: bool
    service_documentation: str = Field(examples=["https://wonderland.example.com/api/v1/reference"])


class ClientRegistration(BaseModel):
    """A machine to be registered."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(min_length=1, max_length=120)
    scopes: list[str] = Field(min_length=1, max_length=32)
    role: Role = "viewer"
    msp_id: str = Field(default="", max_length=64, pattern=r"^[A-Za-z0-9.-]*$")
    jwks: dict[str, Any] | None = Field(
        default=None, description="Public keys (JWKS) of a client that signs assertions; without them it gets a secret"
    )
    certificate: NewCertificate | None = Field(
        default=None, description="The TLS certificate of a client that authenticates by it (RFC 8705)"
    )


class ClientCreated(ApiModel):
    """A new client, and its secret: shown this once."""

    client: RegisteredClient
    client_secret: str | None = None


class TokenAnswer(ApiModel):
    """An access token (RFC 6749, 5.1)."""

    access_token: str
    token_type: Literal["Bearer"]
    expires_in: int = Field(description="Seconds")
    scope: str


class TokenError(ApiModel):
    """Why there is no token (RFC 6749, 5.2)."""

    error: Literal[
        "invalid_request",
        "invalid_client",
        "invalid_grant",
        "unauthorized_client",
        "unsupported_grant_type",
        "invalid_scope",
        "invalid_target",
    ]
    error_description: str


ClientPage = page_of("ClientPage", RegisteredClient)
