"""The statistics and the daily report in Chromium on a real backend."""

from __future__ import annotations

import datetime as dt
import json

from playwright.sync_api import expect
from sqlalchemy import text

DAY_MS = 86_400_000
HEALTH = {"anchors": [{"anchor_id": f"A{number}", "state": "up" if number else "down"} for number in range(4)]}


def test_a_report_of_yesterday_has_the_pads_of_yesterday(real, open_page):
    yesterday_ms = real.now_ms() - DAY_MS
    real.add(
        real.facts.request("then", uav_id="uav-1", t_ms=yesterday_ms),
        real.facts.decide("then", uav_id="uav-1", t_ms=yesterday_ms),
    )
    page = open_page(real.link(), room="statistics")
    now = page.locator("section").filter(has=page.get_by_role("heading", name="Pads now"))
    expect(now).to_contain_text("never reported")

    async def as_it_was():
        """The mirror knew the pad before that day, and the pad reported in the course of it."""
        async with real.backend.database.write() as connection:
            await connection.execute(text("UPDATE block_arrivals SET known_ms = :t"), {"t": yesterday_ms - DAY_MS})
            health = "INSERT INTO pad_health (pad_id, t_ms, received_ms, body) VALUES ('pad-1', :t, :t, :body)"
            body = json.dumps(HEALTH | {"t_ms": yesterday_ms})
            await connection.execute(text(health), {"t": yesterday_ms, "body": body})

    real._run(as_it_was())
    day = dt.datetime.fromtimestamp(yesterday_ms / 1000, dt.UTC).date().isoformat()
    page.goto(f"{real.url}/#/statistics?day={day}")
    then = page.locator("section").filter(has=page.get_by_role("heading", name="Pads at the end of the day"))
    expect(then).to_contain_text("3 of 4 anchors")
    expect(then).to_contain_text("As of")
