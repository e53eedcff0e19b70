"""No endpoint is forgotten: without a sign-in each one refuses, but for those that are listed here."""

from __future__ import annotations

import re

import httpx
from kit.description import document

PUBLIC = {
    ("GET", "/api/v1/health"),
    ("POST", "/api/v1/session"),
    ("GET", "/api/v1/sign-in"),
    ("POST", "/api/v1/sign-in/link"),
    ("POST", "/api/v1/sign-in/link/passkey"),
    ("POST", "/api/v1/sign-in/link/passkey/options"),
    ("POST", "/api/v1/sign-in/oidc"),
    ("POST", "/api/v1/sign-in/passkey"),
    ("POST", "/api/v1/sign-in/passkey/challenge"),
    # What an error means: the same for everybody.
    ("GET", "/api/v1/problems"),
    # Machines: where they sign in, and what anybody has to know to check their tokens.
    ("POST", "/oauth/token"),
    ("GET", "/oauth/jwks.json"),
    ("GET", "/.well-known/oauth-authorization-server"),
}


async def test_every_endpoint_wants_a_sign_in(running):
    asked, open_to_all = 0, []
    async with httpx.AsyncClient(base_url=running.url, trust_env=False) as http:
        for path, operations in document()["paths"].items():
            for method in operations:
                if (method.upper(), path) in PUBLIC:
                    continue
                address = re.sub(r"\{[^}]*\}", "0", path)
                body = {"json": {}} if method in {"post", "put", "patch"} else {}
                answer = await http.request(method.upper(), address, **body)
                asked += 1
                if answer.status_code not in {401, 403}:
                    open_to_all.append((method, path, answer.status_code))
    assert asked > 40
    assert open_to_all == []
