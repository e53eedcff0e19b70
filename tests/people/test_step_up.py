"""Step-up: a stolen cookie, an old assertion, somebody else's, one for another request: none of them lets anything pass."""

from __future__ import annotations

import contextlib
import hashlib
import json

import pytest
from kit.stepping_up import NEEDED
from sqlalchemy import select

from wonderland_backend.auth.step_up import RECENT_MS, SPENT_WITHIN_MS
from wonderland_backend.db.tables.audit import AuditRow

INVITE = {"name": "Grace", "roles": ["inspector"]}
PEOPLE = "/api/v1/people"
JSON = {"Content-Type": "application/json"}


@pytest.fixture
async def ada(fresh):
    async with fresh.administrator() as visitor:
        visitor.http.confirms = False
        yield visitor


def bytes_of(body):
    return json.dumps(body).encode()


async def challenge(who, method="POST", path=PEOPLE, body=INVITE):
    act = {"method": method, "path": path, "body_sha256": hashlib.sha256(bytes_of(body)).hexdigest()}
    return await who.call("POST", "/step-up/challenge", act)


async def confirmed(who, method="POST", path=PEOPLE, body=INVITE):
    """The token for one request."""
    asked = await challenge(who, method, path, body)
    answer = {"ceremony": asked["ceremony"], "credential": who.authenticator.get(asked["options"])}
    return (await who.call("POST", "/step-up", answer))["token"]


async def invite(who, token=None, body=INVITE, path=PEOPLE):
    headers = JSON | ({"Step-Up": token} if token else {})
    return await who.http.post(path, content=bytes_of(body), headers=headers)


def refused(answer):
    assert answer.status_code == 403, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["type"] == NEEDED
    return answer.json()["detail"]


async def people(who):
    return [each["name"] for each in (await who.call("GET", "/people"))["items"]]


async def test_confirmed_it_passes_once(ada):
    assert "passkey" in refused(await invite(ada))
    token = await confirmed(ada)
    assert (await invite(ada, token)).status_code == 201
    assert "used before" in refused(await invite(ada, token, INVITE))
    assert await people(ada) == ["Ada", "Grace"]


async def test_an_assertion_is_answered_once(ada):
    asked = await challenge(ada)
    answer = {"ceremony": asked["ceremony"], "credential": ada.authenticator.get(asked["options"])}
    await ada.call("POST", "/step-up", answer)
    over = await ada.call("POST", "/step-up", answer, status=400)
    assert over["type"].endswith("ceremony-over")
    other = await challenge(ada)
    # The old assertion against the new challenge.
    replayed = await ada.call("POST", "/step-up", answer | {"ceremony": other["ceremony"]}, status=403)
    assert replayed["type"] == NEEDED


async def test_it_is_for_this_very_request(ada):
    for path, body in ((PEOPLE, INVITE | {"roles": ["admin"]}), ("/api/v1/clients", INVITE)):
        refused(await invite(ada, await confirmed(ada), body, path))
    refused(await invite(ada, await confirmed(ada, body=INVITE | {"name": "Mallory"})))
    refused(await invite(ada, await confirmed(ada, method="DELETE")))
    assert await people(ada) == ["Ada"]


async def test_it_is_old_after_two_minutes_and_a_challenge_after_ten(fresh, ada, clock):
    token = await confirmed(ada)
    asked = await challenge(ada)
    clock.now_ms += SPENT_WITHIN_MS
    assert "over" in refused(await invite(ada, token))
    clock.now_ms += 10 * 60_000
    answer = {"ceremony": asked["ceremony"], "credential": ada.authenticator.get(asked["options"])}
    await ada.call("POST", "/step-up", answer, status=400)


@contextlib.asynccontextmanager
async def another_administrator(fresh, ada):
    async with fresh.visitor() as eve:
        made = (await invite(ada, await confirmed(ada, body=EVE), EVE)).json()
        await eve.accept(made["token"])
        eve.http.confirms = False
        yield eve


EVE = {"name": "Eve", "roles": ["admin"]}


async def test_nobody_elses_assertion_counts(fresh, ada):
    async with another_administrator(fresh, ada) as eve:
        # Eve's own token in Ada's browser, Ada's in Eve's.
        assert "somebody else" in refused(await invite(ada, await confirmed(eve)))
        assert "somebody else" in refused(await invite(eve, await confirmed(ada)))
        # Eve's passkey for Ada's challenge, and Ada's challenge answered in Eve's browser.
        for whose, answering in ((ada, ada), (ada, eve)):
            asked = await challenge(whose)
            credential = eve.authenticator.get(asked["options"])
            answer = {"ceremony": asked["ceremony"], "credential": credential}
            await answering.call("POST", "/step-up", answer, status=403)
        assert await people(ada) == ["Ada", "Eve"]


async def test_another_sign_in_of_the_same_person_needs_its_own(fresh, ada):
    """A token that was made in one browser is worth nothing in another one."""
    async with fresh.visitor() as stolen:
        token = await confirmed(ada)
        stolen.authenticator = ada.authenticator
        await stolen.sign_in()
        stolen.http.confirms = False
        refused(await invite(stolen, token))


async def test_a_passkey_that_does_not_verify_its_user_is_none(ada):
    ada.authenticator.verified = False
    asked = await challenge(ada)
    answer = {"ceremony": asked["ceremony"], "credential": ada.authenticator.get(asked["options"])}
    refused_ = await ada.call("POST", "/step-up", answer, status=403)
    assert refused_["type"] == NEEDED
    ada.authenticator.verified = True


async def test_all_that_weighs_is_asked_for(ada):
    """Roles, suspensions, links, machines' secrets, passkeys."""

    async def asked_for(method, path, body=None):
        answer = await ada.http.request(method, f"/api/v1{path}", json=body)
        refused(answer)

    made = (await invite(ada, await confirmed(ada))).json()["person"]
    grace = f"/people/{made['person_id']}"
    me = (await ada.call("GET", "/me"))["passkeys"][0]["credential_id"]
    await asked_for("POST", f"{grace}/link")
    await asked_for("PATCH", grace, {"revision": 0, "roles": ["admin"]})
    await asked_for("POST", "/clients", {"name": "m", "scopes": ["wonderland.pads.read"]})
    await asked_for("POST", "/me/passkeys/options")
    await asked_for("DELETE", f"/me/passkeys/{me}")


async def test_who_may_not_is_not_asked(fresh, ada):
    made = (await invite(ada, await confirmed(ada))).json()
    async with fresh.visitor() as grace:
        await grace.accept(made["token"])
        answer = await grace.http.post(PEOPLE, json=INVITE)
        assert answer.status_code == 403
        assert answer.json()["type"].endswith(":forbidden")


async def test_the_first_passkey_after_a_link_and_only_just_after(fresh, ada, clock):
    sign_ins = fresh.parts.sign_ins
    async with fresh.visitor() as late, fresh.visitor() as soon:
        for who, name in ((late, "Late"), (soon, "Soon")):
            token = await sign_ins.new_token(name, ("admin",))
            await who.call("POST", "/session", {"token": token})
            who.http.confirms = False
        await soon.call("POST", "/me/passkeys/options")
        refused(await invite(late))
        none = await late.http.post(
            "/api/v1/step-up/challenge", json={"method": "POST", "path": PEOPLE, "body_sha256": "0" * 64}
        )
        assert (none.status_code, none.json()["type"].rpartition(":")[2]) == (409, "no-passkey")
        clock.now_ms += RECENT_MS
        refused(await late.http.post("/api/v1/me/passkeys/options"))


async def test_the_log_says_who_confirmed_what(fresh, ada):
    await invite(ada)
    await invite(ada, await confirmed(ada))
    asked = await challenge(ada)
    ada.authenticator.verified = False
    answer = {"ceremony": asked["ceremony"], "credential": ada.authenticator.get(asked["options"])}
    await ada.call("POST", "/step-up", answer, status=403)
    async with fresh.context.database.read() as session:
        rows = (await session.scalars(select(AuditRow).order_by(AuditRow.seq))).all()
    acts = [row.act for row in rows]
    assert acts[-3:] == ["step_up", "person_invited", "step_up_failed"] or acts[-4:-1] == [
        "step_up",
        "person_invited",
        "step_up_failed",
    ]
    assert '"POST /api/v1/people"' in next(row.detail for row in rows if row.act == "step_up")
