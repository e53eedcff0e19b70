"""Webhooks' secrets in the database: encrypted with a key that is not in it, each bound to its row."""

from __future__ import annotations

import os
import stat

import pytest
from kit.webhooks import ca, loopback, poster, webhooks
from sqlalchemy import select, update

from wonderland_backend.db.engine import Database
from wonderland_backend.db.passwords import new_key
from wonderland_backend.db.tables.webhooks import DeliveryRow, SubscriptionRow
from wonderland_backend.errors import SettingsError
from wonderland_backend.webhooks.sealing import SealError, Sealing
from wonderland_backend.webhooks.signing import new_secret

__all__ = ["ca", "loopback", "poster", "webhooks"]

LITE = Database("sqlite:///x.db")  # a name: nothing is opened
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)


async def kept(running):
    async with running.context.database.read() as session:
        return list(await session.scalars(select(SubscriptionRow).order_by(SubscriptionRow.created_ms)))


async def change(running, subscription_id, secret):
    async with running.context.database.write() as connection:
        one = SubscriptionRow.subscription_id == subscription_id
        await connection.execute(update(SubscriptionRow).where(one).values(secret=secret))


async def add(running):
    answer = await running.http.post("/api/v1/subscriptions", json={"url": "https://hooks.example/"})
    assert answer.status_code == 201, answer.text
    return answer.json()["secret"]


@both
async def test_the_database_does_not_have_the_secret(running, poster):
    secret = await add(running)
    (row,) = await kept(running)
    assert row.secret.startswith("sealed:")
    assert secret.removeprefix("whsec_") not in row.secret
    assert running.parts.sealing.open(row.secret, row.subscription_id) == secret


async def test_a_secret_in_another_row_signs_nothing(running, poster, webhooks):
    """Who may write to the database, and has a webhook of his own, would else have others' messages signed with it."""
    for _ in range(2):
        await add(running)
    mine, theirs = await kept(running)
    await change(running, theirs.subscription_id, mine.secret)
    with pytest.raises(SealError, match="cannot be decrypted"):
        running.parts.sealing.open(mine.secret, theirs.subscription_id)


async def test_a_lost_key_is_said_beside_each_delivery_and_nothing_is_sent(running, poster, webhooks):
    await add(running)
    (row,) = await kept(running)
    other = Sealing([bytes(32)], os.urandom)
    await change(running, row.subscription_id, other.seal("whsec_AAAA", row.subscription_id))
    async with running.context.database.write() as connection:
        await connection.execute(update(SubscriptionRow).values(block=-1, tx_index=-1))
    await webhooks.make()
    await webhooks.send_due()
    async with running.context.database.read() as session:
        deliveries = list(await session.scalars(select(DeliveryRow)))
    tried = [each for each in deliveries if each.attempts]
    assert tried
    assert all(each.delivered_ms is None and "webhook_key_file" in each.problem for each in tried)


@both
async def test_secrets_of_before_are_sealed_at_the_next_start(running, poster):
    await add(running)
    (row,) = await kept(running)
    await change(running, row.subscription_id, "whsec_" + "A" * 32)
    await running.parts.sealing.seal_all(running.context.database)
    (sealed,) = await kept(running)
    assert sealed.secret.startswith("sealed:")
    assert running.parts.sealing.open(sealed.secret, row.subscription_id) == "whsec_" + "A" * 32
    await running.parts.sealing.seal_all(running.context.database)
    assert (await kept(running))[0].secret == sealed.secret


def test_a_key_can_be_changed(tmp_path):
    path = tmp_path / "webhook.key"
    before = Sealing.load(path, LITE, os.urandom)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    secret = new_secret(os.urandom)
    sealed = before.seal(secret, "one")
    assert len(sealed) <= 128, "as long as the column"
    assert Sealing.load(path, LITE, os.urandom).open(sealed, "one") == secret
    path.write_bytes(new_key(os.urandom) + path.read_bytes())
    after = Sealing.load(path, LITE, os.urandom)
    assert after.open(sealed, "one") == secret
    assert after.seal(secret, "one") != sealed


@pytest.mark.parametrize("text", ["", "AAAA\n", "é\n", "not base64 at all !!\n"])
def test_a_file_that_has_no_keys_is_named(tmp_path, text):
    path = tmp_path / "webhook.key"
    path.write_text(text)
    with pytest.raises(SettingsError, match=r"webhook_key_file: .*webhook\.key"):
        Sealing.load(path, LITE, os.urandom)
    with pytest.raises(SettingsError, match="webhook_key_file"):
        Sealing.load(tmp_path / "absent" / "webhook.key", LITE, os.urandom)


def test_without_a_path_the_key_is_beside_a_sqlite_database(tmp_path):
    assert Sealing.load(None, Database(f"sqlite:///{tmp_path}/w.db"), os.urandom).is_possible
    assert (tmp_path / "w.db.webhooks.key").exists()
    assert not Sealing.load(None, Database("postgresql://host/w"), os.urandom).is_possible


@pytest.mark.parametrize("length", range(0, 56, 7))
def test_what_is_cut_or_changed_opens_nothing(length):
    sealing = Sealing([bytes(32)], os.urandom)
    sealed = sealing.seal("whsec_AAAA", "one")
    for broken in (sealed[:length], sealed[:length] + "A" + sealed[length + 1 :]):
        if broken != sealed:
            with pytest.raises(SealError):
                sealing.open(broken, "one")


async def test_without_a_key_there_are_no_webhooks(new_backend, serving):
    backend = new_backend(webhook_key_file=None)
    backend.parts.sealing._keys.clear()
    async with serving(backend) as running:
        answer = await running.http.post("/api/v1/subscriptions", json={"url": "https://hooks.example/"})
        assert (answer.status_code, answer.json()["type"]) == (404, "urn:wonderland:problem:switched-off")
        assert "webhook_key_file" in answer.json()["detail"]
