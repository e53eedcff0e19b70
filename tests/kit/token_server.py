"""An authorisation server: client credentials in, JWTs out, its keys published."""

from __future__ import annotations

import base64
import time
import uuid
from urllib.parse import parse_qsl

from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse
from joserfc import jwt


class Authority:
    """Issues tokens; tests turn it off, turn its keys, and have it issue what it should not."""

    def __init__(self, keys):
        self.keys = keys
        self.published = ["first", "elliptic"]
        self.signs_with = "first"
        self.secret = "a secret of tests"
        self.is_down = False
        self.url = ""
        self.jwks_asked = 0
        self.tokens_asked = []
        self.app = FastAPI()
        self.app.get("/jwks")(self.jwks)
        self.app.post("/token")(self.issue)
        self.app.get("/token")(self.issue_dummy)

    async def jwks(self):
        self.jwks_asked += 1
        if self.is_down:
            return JSONResponse({}, 503)
        return {"keys": [self.keys[name].as_dict(private=False) for name in self.published]}

    async def issue(self, request: Request):
        form = dict(parse_qsl((await request.body()).decode()))
        self.tokens_asked.append(form)
        user, _, secret = (
            base64.b64decode(request.headers.get("authorization", "").removeprefix("Basic ")).decode().partition(":")
        )
        if self.is_down:
            return JSONResponse({}, 503)
        if secret != self.secret:
            return JSONResponse({"error": "invalid_client"}, 401)
        token = self.token(scope=form["scope"], sub=user, aud=form["audience"])
        return {"access_token": token, "token_type": "Bearer", "expires_in": 3600}

    async def issue_dummy(self, grant_type: str, scope: str, intended_audience: str, sub: str):
        assert grant_type == "client_credentials"
        return {"access_token": self.token(scope=scope, sub=sub, aud=intended_audience)}

    def token(self, *, now_s=None, key=None, header=None, without=(), **claims):
        """A token; any claim can be another or, by `without`, not there."""
        now_s = int(now_s if now_s is not None else time.time())
        every = {
            "iss": self.url, "sub": "other-uss", "aud": "127.0.0.1", "scope": "rid.display_provider",
            "iat": now_s, "exp": now_s + 1800, "jti": uuid.uuid4().hex,
        } | claims  # fmt: skip
        name = key or self.signs_with
        made = {"alg": "ES256" if name == "elliptic" else "RS256", "kid": self.keys[name].kid} | (header or {})
        made = {each: value for each, value in made.items() if value is not None}
        return jwt.encode(made, {each: value for each, value in every.items() if each not in without}, self.keys[name])
