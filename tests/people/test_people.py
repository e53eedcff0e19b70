"""Invitations, roles, suspension, recovery, sign-ins, passkeys: as administrators and people themselves do them."""

from __future__ import annotations

import asyncio
import json

import pytest
from click.testing import CliRunner

from wonderland_backend.commands import backend
from wonderland_fabric_gateway.ca.local import LocalCa


async def invite(ada, **more):
    body = {"name": "Grace", "email": "Grace@Example.org", "roles": ["inspector"]} | more
    return await ada.call("POST", "/people", body, status=201)


async def test_an_invitation_becomes_an_account(fresh):
    async with fresh.administrator() as ada, fresh.visitor() as grace:
        made = await invite(ada)
        assert (made["person"]["state"], made["person"]["email"]) == ("invited", "grace@example.org")
        shown = await grace.call("POST", "/sign-in/link", {"token": made["token"]})
        assert (shown["kind"], shown["name"], shown["roles"]) == ("invitation", "Grace", ["inspector"])
        signed_in = await grace.accept(made["token"], name="Somebody Else")
        assert signed_in["name"] == "Grace", "the administrator named her"
        await grace.call("GET", "/people", status=403)
        await grace.call("POST", "/sign-in/link", {"token": made["token"]}, status=401)
        people = (await ada.call("GET", "/people"))["items"]
        assert [(each["name"], each["state"], each["passkeys"]) for each in people] == [
            ("Ada", "active", 1),
            ("Grace", "active", 1),
        ]


async def test_an_invitation_is_withdrawn(fresh):
    async with fresh.administrator() as ada, fresh.visitor() as grace:
        made = await invite(ada)
        await ada.call("DELETE", f"/people/{made['person']['person_id']}", status=204)
        await grace.call("POST", "/sign-in/link", {"token": made["token"]}, status=401)
        assert len((await ada.call("GET", "/people"))["items"]) == 1


@pytest.mark.parametrize(
    "body",
    [
        {"roles": []},
        {"roles": ["root"]},
        {"roles": ["pad_operator"]},
        {"email": "nobody"},
        {"email": "a@b\u0000.c"},
        {"name": "<b>\u0007"},
        {"msp_id": "no spaces"},
        # A role and the organisation that gives it.
        {"roles": ["inspector"], "msp_id": "PadMSP"},
        {"roles": ["pad_operator"], "msp_id": "AuthorityMSP"},
        {"roles": ["admin", "fleet_operator"], "msp_id": "FleetMSP"},
        {"more": 1},
    ],
)
async def test_invitations_that_make_no_sense(fresh, body):
    async with fresh.administrator() as ada:
        full = {"name": "Grace", "roles": ["inspector"]} | body
        refused = await ada.call("POST", "/people", full, status=422)
        assert refused["errors"]


async def test_an_organisation_is_one_of_the_channel(fresh, tmp_path):
    root = LocalCa.create(tmp_path / "pad", "PadMSP").root_pem().decode()
    definition = {"root_certs": [root], "intermediate_certs": [], "revocation_lists": [], "sections": ["Application"]}
    orders = definition | {"sections": ["Orderer"]}
    fresh.parts.members.configure([("PadMSP", json.dumps(definition)), ("OrdererMSP", json.dumps(orders))])
    async with fresh.administrator() as ada:
        body = {"name": "Pat", "roles": ["pad_operator"], "msp_id": "PdaMSP"}
        refused = await ada.call("POST", "/people", body, status=409)
        assert "PdaMSP" in refused["detail"]
        assert "PadMSP" in refused["detail"]
        refused = await ada.call("POST", "/people", body | {"msp_id": "OrdererMSP"}, status=409)
        assert refused["detail"].endswith("organisations: PadMSP."), "one that only orders has no pads"
        made = await ada.call("POST", "/people", body | {"msp_id": "PadMSP"}, status=201)
        path = f"/people/{made['person']['person_id']}"
        await ada.call("PATCH", path, {"revision": 0, "msp_id": "FleetMSP"}, status=409)
        await ada.call("PATCH", path, {"revision": 0, "name": "Patricia"})


async def test_an_address_is_one_persons(fresh):
    async with fresh.administrator() as ada:
        await invite(ada)
        refused = await ada.call(
            "POST", "/people", {"name": "G", "email": "grace@example.ORG", "roles": ["viewer"]}, status=409
        )
        assert "already" in refused["detail"]


async def test_roles_change_at_once_and_two_administrators_do_not_overwrite_each_other(fresh):
    async with fresh.administrator() as ada, fresh.visitor() as grace:
        made = await invite(ada)
        await grace.accept(made["token"])
        path = f"/people/{made['person']['person_id']}"
        person = (await ada.call("GET", path))["person"]
        change = {"revision": person["revision"], "roles": ["viewer", "admin"]}
        changed = await ada.call("PATCH", path, change)
        assert changed["person"]["roles"] == ["admin", "viewer"]
        assert len((await grace.call("GET", "/people"))["items"]) == 2
        await ada.call("PATCH", path, {**change, "roles": ["viewer"]}, status=409)
        refused = await ada.call("PATCH", path, {"revision": 2, "roles": ["fleet_operator"]}, status=409)
        assert "organisation" in refused["detail"]
        operator = {"revision": 2, "roles": ["fleet_operator"], "msp_id": "FleetMSP"}
        assert (await ada.call("PATCH", path, operator))["person"]["msp_id"] == "FleetMSP"
        await grace.call("GET", "/people", status=403)


async def test_suspended_is_signed_out_and_stays_out(fresh):
    async with fresh.administrator() as ada, fresh.visitor() as grace:
        made = await invite(ada)
        await grace.accept(made["token"])
        path = f"/people/{made['person']['person_id']}"
        await ada.call("PATCH", path, {"revision": 1, "state": "suspended"})
        await grace.call("GET", "/me", status=401)
        await grace.sign_in(status=401)
        await ada.call("POST", f"{path}/link", status=409)
        await ada.call("PATCH", path, {"revision": 2, "state": "active"})
        await grace.sign_in()


async def test_an_account_is_suspended_without_the_console_while_the_server_runs(fresh, database_url):
    async def command(*words, code=0):
        done = await asyncio.to_thread(CliRunner().invoke, backend, ["person", *words, "--database", database_url])
        assert done.exit_code == code, done.output
        return done.output

    async with fresh.administrator() as ada, fresh.visitor() as grace:
        made = await invite(ada)
        await grace.accept(made["token"])
        await grace.call("GET", "/me")
        theirs = made["person"]["person_id"]
        assert {each["person_id"]: each["state"] for each in json.loads(await command("list", "--json"))}[
            theirs
        ] == "active"
        await command("suspend", "--account", theirs, "--reason", "after a restore")
        await grace.call("GET", "/me", status=401)
        await grace.sign_in(status=401)
        assert f"{theirs}  suspended" in await command("list")
        assert "suspended already" in await command("suspend", "--account", theirs, "--reason", "x", code=1)
        mine = (await ada.call("GET", "/me"))["person"]["person_id"]
        await command("suspend", "--account", mine, "--reason", "x", code=1)  # the last administrator
        await command("suspend", "--account", "0" * 32, "--reason", "x", code=1)
        (row,) = (await ada.call("GET", "/audit?act=person_suspended"))["items"]
        assert (row["person"], row["detail"]["reason"]) == ("the server's administrator", "after a restore")
        await ada.call("PATCH", f"/people/{theirs}", {"revision": 2, "state": "active"})
        await grace.sign_in()


async def test_there_is_always_an_administrator(fresh):
    async with fresh.administrator() as ada, fresh.visitor() as grace:
        me = (await ada.call("GET", "/me"))["person"]
        mine = f"/people/{me['person_id']}"
        for change in ({"state": "suspended"}, {"roles": ["viewer"]}):
            await ada.call("PATCH", mine, {"revision": 0, **change}, status=409)
        made = await invite(ada, roles=["admin"])
        await grace.accept(made["token"])
        theirs = f"/people/{made['person']['person_id']}"
        done = await asyncio.gather(
            ada.http.patch(f"/api/v1{theirs}", json={"revision": 1, "roles": ["viewer"]}),
            grace.http.patch(f"/api/v1{mine}", json={"revision": 0, "roles": ["viewer"]}),
        )
        assert 200 in {each.status_code for each in done}
        assert {each.status_code for each in done} <= {200, 403, 409}
        admins = []
        for who in (ada, grace):
            answer = await who.http.get("/api/v1/people")
            if answer.status_code == 200:
                admins = [each for each in answer.json()["items"] if "admin" in each["roles"]]
        assert len(admins) == 1


async def test_recovery_ends_everything_that_was_before(fresh):
    async with fresh.administrator() as ada, fresh.visitor() as grace, fresh.visitor() as again:
        made = await invite(ada)
        await grace.accept(made["token"])
        link = await ada.call("POST", f"/people/{made['person']['person_id']}/link", status=201)
        assert (await again.call("POST", "/sign-in/link", {"token": link["token"]}))["kind"] == "recovery"
        await grace.call("GET", "/me")
        await again.accept(link["token"], passkey="new")
        await grace.call("GET", "/me", status=401)
        await grace.sign_in(status=401)
        assert [each["name"] for each in (await again.call("GET", "/me"))["passkeys"]] == ["new"]


async def test_passkeys_are_added_renamed_and_removed_but_not_the_last(fresh):
    async with fresh.administrator() as ada:
        first = (await ada.call("GET", "/me"))["passkeys"][0]["credential_id"]
        refused = await ada.call("DELETE", f"/me/passkeys/{first}", status=409)
        assert "only way" in refused["detail"]
        me = await ada.add_passkey("phone")
        assert [each["name"] for each in me["passkeys"]] == ["laptop", "phone"]
        me = await ada.call("PATCH", f"/me/passkeys/{first}", {"name": "old laptop"})
        assert me["passkeys"][0]["name"] == "old laptop"
        await ada.call("DELETE", f"/me/passkeys/{first}")
        await ada.call("DELETE", f"/me/passkeys/{first}", status=404)
        await ada.sign_in()


async def test_sign_ins_are_listed_and_ended(fresh, clock):
    async with fresh.administrator() as ada, fresh.visitor(ada.authenticator) as other:
        clock.now_ms += 1_000
        await other.sign_in()
        listed = (await ada.call("GET", "/me"))["sign_ins"]
        assert [each["current"] for each in listed] == [False, True]
        await ada.call("DELETE", f"/me/sign-ins/{listed[0]['sign_in_id']}")
        await other.call("GET", "/me", status=401)
        clock.now_ms += 1_000
        await other.sign_in()
        me = (await ada.call("GET", "/me"))["person"]["person_id"]
        theirs = (await ada.call("GET", f"/people/{me}"))["sign_ins"]
        await ada.call("DELETE", f"/people/{me}/sign-ins/{theirs[0]['sign_in_id']}")
        await other.call("GET", "/me", status=401)


async def test_signing_in_anew_ends_what_the_browser_had(fresh):
    async with fresh.administrator() as ada, fresh.visitor(ada.authenticator) as other:
        (name, former) = next((each.name, each.value) for each in ada.http.cookies.jar)
        await other.sign_in()
        await ada.sign_in()
        assert ada.http.cookies[name] != former
        other.http.headers["Cookie"] = f"{name}={former}"
        await other.call("GET", "/me", status=401)
        assert len((await ada.call("GET", "/me"))["sign_ins"]) == 2, "another browser's stays"


async def test_a_passkey_that_was_copied_is_noticed(fresh):
    async with fresh.administrator() as ada:
        ada.authenticator.count = 100
        await ada.sign_in()
        ada.authenticator.count = 50
        await ada.sign_in(status=401)


async def test_an_answer_counts_once_and_in_time(fresh, clock):
    async with fresh.administrator() as ada:
        asked = await ada.call("POST", "/sign-in/passkey/challenge")
        body = {"ceremony": asked["ceremony"], "credential": ada.authenticator.get(asked["options"])}
        await ada.call("POST", "/sign-in/passkey", body)
        await ada.call("POST", "/sign-in/passkey", body, status=400)
        asked = await ada.call("POST", "/sign-in/passkey/challenge")
        body = {"ceremony": asked["ceremony"], "credential": ada.authenticator.get(asked["options"])}
        clock.now_ms += 11 * 60_000
        await ada.call("POST", "/sign-in/passkey", body, status=400)


async def test_attempts_are_limited(fresh, clock):
    async with fresh.visitor() as eve:
        codes = [(await eve.http.post("/api/v1/sign-in/link", json={"token": "x"})).status_code for _ in range(61)]
        assert codes == [401] * 60 + [429]
        clock.now_ms += 60_000
        await eve.call("POST", "/sign-in/link", {"token": "x"}, status=401)
