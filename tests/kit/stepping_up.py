"""Clients that confirm by a passkey where they are asked to, as the console does, and then send the same again."""

from __future__ import annotations

import hashlib

import httpx

from kit.authenticator import Authenticator

NEEDED = "urn:wonderland:problem:step-up-required"


def act_of(request):
    """What an assertion is asked for."""
    path = request.url.raw_path.decode().partition("?")[0]
    return {"method": request.method, "path": path, "body_sha256": hashlib.sha256(request.content).hexdigest()}


def confirmation(authenticator, act):
    """What to post, as a generator of (path, body) that is resumed with each answer; returns the token.

    Somebody without a passkey makes one, which a link of just now allows.
    """
    if not authenticator.keys:
        asked = yield "/me/passkeys/options", None
        made = {"ceremony": asked["ceremony"], "credential": authenticator.create(asked["options"])}
        yield "/me/passkeys", made | {"name": "in software"}
    asked = yield "/step-up/challenge", act
    answer = {"ceremony": asked["ceremony"], "credential": authenticator.get(asked["options"])}
    granted = yield "/step-up", answer
    return granted["token"]


class Confirming:
    """What both clients have."""

    confirms = True
    authenticator = None

    def hands(self):
        """The authenticator of whoever is signed in now."""
        if self.authenticator is not None:
            return self.authenticator
        known = self.__dict__.setdefault("_hands", {})
        return known.setdefault(str(sorted(self.cookies.items())), Authenticator("http://localhost"))

    def asked(self, request, answer):
        return (
            self.confirms
            and answer.status_code == 403
            and "Step-Up" not in request.headers
            and "authorization" not in request.headers
        )


def next_step(steps, told):
    """(path, body), None or None, token."""
    try:
        return steps.send(told), None
    except StopIteration as done:
        return None, done.value


class ConfirmingClient(Confirming, httpx.Client):
    """A blocking one."""

    def send(self, request, **options):
        answer = super().send(request, **options)
        if not self.asked(request, answer) or answer.json()["type"] != NEEDED:
            return answer
        steps, told = confirmation(self.hands(), act_of(request)), None
        while (step := next_step(steps, told))[0] is not None:
            told = self.post(f"/api/v1{step[0][0]}", json=step[0][1]).raise_for_status().json()
        request.headers["Step-Up"] = step[1]
        return super().send(request, **options)


class ConfirmingAsyncClient(Confirming, httpx.AsyncClient):
    """One that is awaited."""

    async def send(self, request, **options):
        answer = await super().send(request, **options)
        if not self.asked(request, answer):
            return answer
        await answer.aread()
        if answer.json()["type"] != NEEDED:
            return answer
        steps, told = confirmation(self.hands(), act_of(request)), None
        while (step := next_step(steps, told))[0] is not None:
            told = (await self.post(f"/api/v1{step[0][0]}", json=step[0][1])).raise_for_status().json()
        request.headers["Step-Up"] = step[1]
        return await super().send(request, **options)
