"""The first start: nothing but setting up; and links, which serve once."""

from __future__ import annotations

import asyncio

import pytest
import websockets

PATHS = ["/session", "/status", "/pads", "/people", "/me", "/audit", "/metrics", "/nothing"]


@pytest.mark.parametrize("path", PATHS)
async def test_before_it_is_set_up_everything_else_is_refused(fresh, path):
    async with fresh.visitor() as anybody:
        refused = await anybody.call("GET", path, status=403)
        assert refused["type"] == "urn:wonderland:problem:set-up-required"
        assert "open the link" in refused["detail"]


async def test_before_it_is_set_up_the_way_to_it_is_open(fresh):
    async with fresh.visitor() as anybody:
        assert (await anybody.call("GET", "/health"))["status"] == "ok"
        ways = await anybody.call("GET", "/sign-in")
        assert ways == {"set_up": False, "demo": False, "site": "localhost"}
        assert (await anybody.http.get("/")).status_code == 200
    for path in ("/ingest", "/api/v1/live"):
        async with websockets.connect(fresh.address.replace("http", "ws") + path, proxy=None) as socket:
            with pytest.raises(websockets.ConnectionClosed) as closed:
                await socket.recv()
            assert closed.value.rcvd.code == 1013


async def test_the_first_administrator_names_herself_and_signs_in_by_passkey(fresh):
    token = await fresh.set_up_token()
    async with fresh.visitor() as ada:
        shown = await ada.call("POST", "/sign-in/link", {"token": token})
        assert (shown["kind"], shown["roles"]) == ("set_up", ["admin"])
        signed_in = await ada.accept(token, name="  Ada Lovelace ")
        assert (signed_in["name"], signed_in["roles"], signed_in["method"]) == ("Ada Lovelace", ["admin"], "passkey")
        assert (await ada.call("GET", "/sign-in"))["set_up"] is True
        assert (await ada.call("GET", "/pads"))["items"] == []
        await ada.call("DELETE", "/session", status=204)
        await ada.call("GET", "/me", status=401)
        assert (await ada.sign_in())["name"] == "Ada Lovelace"
        me = await ada.call("GET", "/me")
        assert [(each["name"], "last_used_ms" in each) for each in me["passkeys"]] == [("laptop", True)]
        assert [(each["method"], each["current"]) for each in me["sign_ins"]] == [("passkey", True)]
        await ada.call("POST", "/sign-in/link", {"token": token}, status=401)


async def test_only_one_of_those_who_have_the_link_sets_it_up(fresh):
    token = await fresh.set_up_token()
    async with fresh.visitor() as ada, fresh.visitor() as eve:
        asked = [await each.call("POST", "/sign-in/link/passkey/options", {"token": token}) for each in (ada, eve)]
        answers = [
            {"ceremony": each["ceremony"], "credential": who.authenticator.create(each["options"]), "passkey_name": "k"}
            for who, each in zip((ada, eve), asked, strict=True)
        ]
        done = await asyncio.gather(
            *(
                who.http.post("/api/v1/sign-in/link/passkey", json=answer)
                for who, answer in zip((ada, eve), answers, strict=True)
            )
        )
        assert sorted(each.status_code for each in done) == [200, 401]


async def test_the_set_up_link_expires_and_a_later_one_replaces_it(fresh, clock):
    first = await fresh.set_up_token()
    second = await fresh.set_up_token()
    async with fresh.visitor() as ada:
        await ada.call("POST", "/sign-in/link", {"token": first}, status=401)
        await ada.call("POST", "/sign-in/link", {"token": second})
        clock.now_ms += 15 * 60_000
        await ada.call("POST", "/sign-in/link", {"token": second}, status=401)


async def test_once_set_up_there_is_no_other_link(fresh):
    token = await fresh.set_up_token()
    async with fresh.visitor() as ada:
        await ada.accept(token, name="Ada")
        assert await fresh.set_up_token() is None


@pytest.mark.parametrize(
    ("bend", "status"),
    [
        ({"origin": "http://evil.example"}, 400),
        ({"verified": False}, 400),
    ],
)
async def test_a_passkey_of_elsewhere_or_of_an_unverified_user_is_refused(fresh, bend, status):
    token = await fresh.set_up_token()
    async with fresh.visitor() as eve:
        vars(eve.authenticator).update(bend)
        asked = await eve.call("POST", "/sign-in/link/passkey/options", {"token": token})
        credential = eve.authenticator.create(asked["options"])
        body = {"ceremony": asked["ceremony"], "credential": credential, "passkey_name": "k"}
        await eve.call("POST", "/sign-in/link/passkey", body, status=status)
        await eve.call("POST", "/sign-in/link", {"token": token})
        await eve.call("GET", "/pads", status=403)
        refused = await eve.call("POST", "/sign-in/link/passkey", body, status=400)
        assert refused["type"].endswith("ceremony-over")


@pytest.mark.parametrize("name", ["", "   ", "a\u0000b", "a\u202eb", "x" * 101])
async def test_names_that_are_none(fresh, name):
    token = await fresh.set_up_token()
    async with fresh.visitor() as ada:
        await ada.call("POST", "/sign-in/link/passkey/options", {"token": token, "name": name}, status=422)


MALFORMED = [{}, {"id": 5}, {"id": "x" * 2000}, {"id": "AAAA", "response": []}, {"id": "a", "response": {"x": None}}]


@pytest.mark.parametrize("credential", MALFORMED)
async def test_malformed_credentials(fresh, credential):
    token = await fresh.set_up_token()
    async with fresh.visitor() as eve:
        asked = await eve.call("POST", "/sign-in/link/passkey/options", {"token": token})
        body = {"ceremony": asked["ceremony"], "credential": credential, "passkey_name": "k"}
        await eve.call("POST", "/sign-in/link/passkey", body, status=400)
        await eve.accept(token, name="Ada")
        asked = await eve.call("POST", "/sign-in/passkey/challenge")
        await eve.call("POST", "/sign-in/passkey", {"ceremony": asked["ceremony"], "credential": credential}, 401)
