"""Operators' numbers as a backend keeps them, with salts that a test can make again."""

from __future__ import annotations

import hashlib
import secrets

from wonderland.proofs.registration import Opening
from wonderland_backend.numbers import store

NUMBER = "FIN87astrdge12k8"
DRONES = ("uav-1", "uav-2", "uav-9")


def opening(uav_id="uav-1", number=NUMBER):
    """What the records of `kit.facts` commit to."""
    return Opening.of(uav_id, number, hashlib.sha256(f"{uav_id} {number}".encode()).digest())


def fresh(uav_id, number=NUMBER):
    """As somebody would draw it."""
    return Opening.of(uav_id, number, secrets.token_bytes(32))


def told(an_opening):
    """As a proposal brings it."""
    return {"registration": an_opening.registration, "salt": an_opening.salt}


async def keep(database, *openings, tx_id=None):
    async with database.write() as connection:
        for each in openings:
            await store.keep(connection, each, "the kit", 1, tx_id=tx_id)


async def keep_usual(database, drones=DRONES):
    """The numbers of the drones that most tests have."""
    await keep(database, *(opening(each) for each in drones))
