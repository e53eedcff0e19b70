"""Replay in Chromium on a real backend with a stored past: yesterday 14:00, what was selected stays so, out as files."""

from __future__ import annotations

import csv
import io
import json
import re
import zipfile
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from kit.chain import number
from playwright.sync_api import expect
from sqlalchemy import insert

from wonderland_backend.db.tables.reported import LatestTrackRow, TrackMinuteRow, TrackRow
from wonderland_backend.settings.outputs import OutputSettings
from wonderland_backend.zones import importing

SECOND = 1_000
TURKU = Path(__file__).parents[1] / "zones" / "files" / "turku.ed318.json"


def yesterday_ms(hours, minutes=0, seconds=0):
    """Yesterday by the clock on the wall, as the browser has it."""
    now = datetime.now().astimezone()
    at = (now - timedelta(days=1)).replace(hour=hours, minute=minutes, second=seconds, microsecond=0)
    return int(at.timestamp() * 1000)


async def store_tracks(database, first_ms, last_ms):
    """A drone that is heard each second, flying north."""
    rows = [
        {
            "uav_id": "uav-2",
            "pad_id": "pad-1",
            "t_ms": t_ms,
            "received_ms": t_ms + 40,
            "body": json.dumps(
                {
                    "uav_id": "uav-2",
                    "lat_e7": 604_518_000 + (t_ms - first_ms) // 100,
                    "lon_e7": 222_666_000,
                    "t_ms": t_ms,
                    "pad_id": "pad-1",
                    "transport": "wifi",
                    "verified": False,
                }
            ),
        }
        for t_ms in range(first_ms, last_ms, SECOND)
    ]
    latest = {name: rows[-1][name] for name in ("uav_id", "pad_id", "t_ms", "body")}
    async with database.write() as connection:
        await connection.execute(insert(TrackRow), rows)
        await connection.execute(insert(LatestTrackRow), [latest])
        await connection.execute(insert(TrackMinuteRow), [{"minute_ms": first_ms, "positions": len(rows)}])


@pytest.fixture
def past(authorities, tmp_path, built_console):
    """A backend that starts today on a ledger of yesterday, with positions of yesterday."""
    from kit.console import RealBackend

    running = RealBackend(authorities, tmp_path, built_console)
    try:
        facts = running.facts
        begun = [facts.put_pad(), facts.put_uav(), facts.put_uav("uav-2")]
        for transaction in begun:
            transaction.t_ms = yesterday_ms(13)
        running.add(*begun)
        for name, uav_id, outcome, t_ms in (
            ("one", "uav-1", "verified", yesterday_ms(13, 30)),
            ("two", "uav-2", "refuted", yesterday_ms(14, 5)),
        ):
            running.add(facts.request(name, uav_id=uav_id, t_ms=t_ms))
            running.add(facts.decide(name, uav_id=uav_id, t_ms=t_ms, outcome=outcome))
        running.start()
        running._run(store_tracks(running.backend.database, yesterday_ms(13, 55), yesterday_ms(14, 10)))
        yield running
    finally:
        running.close()


@pytest.fixture
def room(past, open_page):
    page = open_page(past.link(), width=1440, height=900)
    expect(page.get_by_role("link", name="Replay")).to_be_visible()
    page.get_by_role("link", name="Replay").click()
    expect(page.get_by_text("Replay, not live")).to_be_visible()
    return page


def go(page, text):
    field = page.get_by_role("textbox", name="Time", exact=True)
    field.fill(text)
    field.press("Enter")


def time(page):
    return page.get_by_test_id("replay-time")


def row(page):
    return page.get_by_role("option").filter(has_text="uav-2")


def test_yesterday_14_00_and_what_happened_after(room):
    go(room, "yesterday 14:00")
    expect(time(room)).to_have_text("14:00:00")
    expect(row(room)).to_be_visible()
    row(room).click()
    expect(room.get_by_role("region", name="Replay")).to_contain_text("uav-2")
    expect(room.get_by_role("region", name="Replay")).not_to_contain_text("Refuted")
    room.keyboard.press("n")
    expect(time(room)).to_have_text("14:05:02")
    expect(room.get_by_role("heading", name="Refuted")).to_be_visible()
    assert "drone=uav-2" in room.url, "what was selected stays selected"
    room.get_by_role("button", name="Alerts 0").click()
    expect(room.get_by_role("region", name="Drones and alerts at that time")).to_contain_text("No alert was open.")
    room.keyboard.press("n")
    expect(room.get_by_text("No later refusal.")).to_be_visible()
    room.go_back()
    expect(time(room)).to_have_text("14:00:00")
    expect(room.get_by_role("heading", name="Refuted")).to_have_count(0)
    room.reload()
    expect(time(room)).to_have_text("14:00:00")
    expect(room.get_by_role("region", name="Replay")).to_contain_text("uav-2")
    room.get_by_role("link", name="Go live").click()
    room.wait_for_url("**/#/live?drone=uav-2**")


def test_yesterday_14_00_from_anywhere_without_a_click(past, open_page):
    from kit.officer import Officer

    page = open_page(past.link(), width=1440, height=900)
    expect(page.get_by_role("link", name="Ledger")).to_be_visible()
    officer = Officer(page)
    officer.press("/")
    officer.type("yesterday 14:00")
    expect(page.get_by_role("option").filter(has_text="14:00:00")).to_have_attribute("aria-selected", "true")
    officer.press("Enter")
    expect(time(page)).to_have_text("14:00:00")
    expect(row(page)).to_be_visible()
    officer.did("replay yesterday 14:00", at_most=4)


def test_it_plays_at_the_chosen_speed_and_by_keys(room):
    go(room, "yesterday 13:58")
    expect(row(room)).to_be_visible()
    for key, shown in (("ArrowRight", "13:58:10"), ("ArrowLeft", "13:58:00"), (".", "13:58:01"), (",", "13:58:00")):
        room.keyboard.press(key)
        expect(time(room)).to_have_text(shown)
    room.keyboard.press("l")
    room.keyboard.press("l")
    room.keyboard.press("l")
    expect(room.get_by_label("Speed")).to_have_value("10")
    assert "#/replay" in room.url, "l is faster here, not the live map"
    room.keyboard.press(" ")
    expect(room.get_by_role("button", name="Pause")).to_be_visible()
    expect(time(room)).to_have_text(re.compile("13:58:[45]|13:59"))
    room.keyboard.press("k")
    expect(room.get_by_role("button", name="Play", exact=True)).to_be_visible()
    stopped = time(room).text_content()
    assert "13:58:40" <= stopped <= "13:59:59"
    slider = room.get_by_role("slider", name="Time")
    assert stopped in slider.get_attribute("aria-valuetext")


def test_a_time_that_cannot_be_read_is_said_and_nothing_moves(room):
    go(room, "yesterday 14:00")
    expect(time(room)).to_have_text("14:00:00")
    go(room, "half past <b>never</b>")
    expect(room.get_by_role("alert")).to_contain_text("No time that can be read")
    expect(time(room)).to_have_text("14:00:00")


@pytest.fixture
def zoned(past):
    """The same with zones that held for a while.

    Its clock is put back for that, while no page is open: one that hears a frame then learns the clock from it, and
    what is typed as "yesterday" before the next frame is the day before.
    """

    def at(t_ms, coroutine):
        past.off_ms = t_ms - past.now_ms()
        past._run(coroutine)
        past.off_ms = 0

    context = past.backend.context
    at(yesterday_ms(13, 40), importing.import_data(context, "Anna", TURKU.read_bytes(), "turku"))
    # The map asks for whole minutes, and an end takes effect some milliseconds after the clock was read here.
    at(yesterday_ms(14, 2, 30), importing.end(context, "Anna", "turku"))
    return past


def test_the_map_shows_the_zones_that_held_then(zoned, room):
    prohibited = room.locator(".zones-legend").get_by_text("Prohibited")
    for typed, shown, there in (
        ("yesterday 13:39:30", "13:39:30", 0),
        ("yesterday 14:00", "14:00:00", 1),
        ("yesterday 14:03:30", "14:03:30", 0),
        ("yesterday 14:01", "14:01:00", 1),
    ):
        go(room, typed)
        expect(time(room)).to_have_text(shown)
        expect(prohibited).to_have_count(there)
    room.get_by_role("button", name="Hide zones").click()
    expect(prohibited).to_have_count(0)
    assert "zones=off" in room.url


def test_measure_follow_and_the_same_as_a_table(room):
    go(room, "yesterday 14:00")
    row(room).click()
    panel = room.get_by_role("region", name="Replay")
    panel.get_by_role("button", name="Follow").click()
    expect(panel.get_by_role("button", name="Follow")).to_have_attribute("aria-pressed", "true")
    expect(room).to_have_url(re.compile("follow"))
    before = re.search(r"at=([0-9.]+)", room.url)[1]
    go(room, "yesterday 14:04")
    # It flew north for four minutes, and the camera with it.
    expect(time(room)).to_have_text("14:04:00")
    room.wait_for_function(
        "before => Number(/at=([0-9.]+)/.exec(location.hash)[1]) > Number(before) + 0.0001", arg=before
    )
    room.keyboard.press("m")
    room.keyboard.press("Enter")
    room.keyboard.press("ArrowRight")
    bar = room.get_by_role("region", name="Measure")
    expect(bar).to_be_visible()
    assert "measure=" in room.url
    room.keyboard.press("Escape")
    expect(bar).to_have_count(0)
    room.keyboard.press("x")
    table = room.get_by_role("table")
    expect(table.locator("caption")).to_contain_text("1 drone")
    expect(table).to_contain_text("uav-2")
    expect(room).to_have_url(re.compile("#/replay.*table"))
    table.get_by_role("link", name="uav-2").click()
    expect(table).to_have_count(0)
    expect(time(room)).to_have_text("14:04:10")
    expect(room).to_have_url(re.compile("#/replay.*drone=uav-2"))


def test_a_window_goes_out_as_files(room, tmp_path):
    go(room, "yesterday 14:00")
    expect(row(room)).to_be_visible()

    def export(label):
        """The files of the archive by name."""
        room.get_by_role("button", name="Export…").click()
        room.get_by_label(label).check()
        room.get_by_role("button", name="Prepare").click()
        with room.expect_download() as download:
            room.get_by_role("link", name="Download").click()
        path = tmp_path / f"{label}.zip"
        download.value.save_as(path)
        expect(room.get_by_text("SHA-256")).to_be_visible()
        room.keyboard.press("Escape")
        expect(room.get_by_role("button", name="Prepare")).to_have_count(0)
        with zipfile.ZipFile(path) as packed:
            files = {name: packed.read(name) for name in packed.namelist()}
        counts = json.loads(files.pop("manifest.json"))["counts"]
        assert (counts["claimed"], counts["verdict"]) == (15 * 60, 2)
        return files

    features = json.loads(export("GeoJSON")["window.geojson"])["features"]
    assert {each["properties"]["kind"] for each in features} == {"claimed", "verdict"}
    tables = export("CSV")
    claimed = list(csv.DictReader(io.StringIO(tables["claimed.csv"].decode("utf-8-sig"))))
    assert len(claimed) == 15 * 60
    assert (claimed[0]["uav_id"], claimed[0]["lat_e7"]) == ("uav-2", "604518000")
    verdicts = csv.DictReader(io.StringIO(tables["verdict.csv"].decode("utf-8-sig")))
    assert [each["outcome"] for each in verdicts] == ["verified", "refuted"]
    moving = json.loads(export("OGC Moving Features")["window.mf.json"])
    (path,) = (each for each in moving["features"] if each["properties"]["kind"] == "claimed")
    (point,) = path["temporalGeometry"]["prisms"]
    assert (point["type"], len(point["datetimes"]), len(point["coordinates"])) == ("MovingPoint", 15 * 60, 15 * 60)


@pytest.mark.parametrize(("on", "shown"), [(["csv"], "CSV tables"), ([], "Exports are switched off on this server.")])
def test_what_is_switched_off_is_not_offered(past, room, on, shown):
    past.backend.settings.__dict__["outputs"] = OutputSettings(exports=on)
    room.get_by_role("button", name="Export…").click()
    dialog = room.get_by_role("dialog")
    expect(dialog).to_contain_text(shown)
    expect(dialog.get_by_label("OGC Moving Features")).to_have_count(0)
    expect(dialog.get_by_role("radio", checked=True)).to_have_count(len(on))
    prepare = dialog.get_by_role("button", name="Prepare")
    expect(prepare).to_be_enabled() if on else expect(prepare).to_be_disabled()


def test_links_lead_to_the_moment(past, open_page):
    page = open_page(past.link(), width=1440, height=900)
    expect(page.get_by_role("link", name="Sessions")).to_be_visible()
    session_id = number("session", "two")
    # The course of a proof is not to be had from evidence that no pad measured.
    page.watched.expected = ("404",)
    page.goto(f"{past.url}/#/sessions/{session_id}")
    page.get_by_role("link", name="Replay this").click()
    expect(time(page)).to_have_text("14:05:04")
    page.go_back()
    expect(page.get_by_role("link", name="Replay this")).to_be_visible()
