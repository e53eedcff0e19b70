"""What another provider tells, as an officer meets it on the map: two backends, a DSS, Chromium."""

from __future__ import annotations

import pytest
from kit import barriers
from kit.browser import FLAGS, FRONTEND, OFFLINE, PATIENCE_MS, chromium_program
from playwright.async_api import async_playwright, expect
from sqlalchemy import select

from wonderland_backend.db.tables.audit import AuditRow

pytestmark = pytest.mark.browser


@pytest.fixture
async def chromium():
    """For tests whose servers run in the test's own event loop."""
    try:
        manager = await async_playwright().start()
    except Exception as error:  # noqa: BLE001 - playwright raises plain Exceptions
        pytest.skip(f"playwright's driver does not start here: {error}")
    try:
        program = chromium_program(manager)
        if program is None:
            pytest.skip("no Chromium here: neither playwright's own nor one on the PATH")
        expect.set_options(timeout=PATIENCE_MS)
        running = await manager.chromium.launch(executable_path=program, args=[*FLAGS, OFFLINE])
        yield running
        await running.close()
    finally:
        await manager.stop()


@pytest.fixture
def console():
    built = FRONTEND / "dist"
    if not (built / "index.html").is_file():
        pytest.skip("the console is not built (make setup)")
    return built


async def test_an_officer_looks_at_flights_that_others_tell_of(new_uss, dss, console, chromium, track, until):
    axe = barriers.axe()
    async with (
        new_uss(dss=[dss.url], client_id="us", console=console) as us,
        new_uss(dss=[dss.url], client_id="them") as them,
    ):
        now = them.uspace.clock()
        await them.heard(track(claim_t_ms=now - 2_000))
        await them.heard(track(lat=604_519_000, claim_t_ms=now - 500))
        # Ours is a drone of the map already: it is not told a second time.
        await us.heard(track("OURS", lng=222_680_000, claim_t_ms=now - 500))
        await until(lambda: dss.areas)
        # Closed before the servers, which wait for their connections.
        async with await chromium.new_page(viewport={"width": 1280, "height": 800}, reduced_motion="reduce") as page:
            page.set_default_timeout(PATIENCE_MS)
            await look_at(page, us, them, axe)


async def look_at(page, us, them, axe):
    complaints = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda message: message.type == "error" and complaints.append(message.text))
    await page.goto(f"{us.url}/#token={await us.set_up()}")
    await expect(page.get_by_role("link", name="Live")).to_be_visible()

    # The whole country is more than the standard lets anybody see.
    await page.evaluate("location.hash = '#/live?at=60.4519,22.2666,9'")
    await page.get_by_role("button", name="Flights that other providers tell of").click()
    card = page.get_by_role("region", name="Networked flights")
    await expect(card).to_contain_text("Shown in views up to 7 km across")
    assert "networked" in await page.evaluate("location.hash")

    # Closer, but not close: an area with so many flights.
    await page.evaluate("location.hash = '#/live?at=60.4519,22.2666,13.6&networked'")
    await expect(card).to_contain_text("2 flights in 1 area, ours included")
    # A single one, with its provider's name and nothing of our own.
    await page.evaluate("location.hash = '#/live?at=60.4519,22.2666,17&networked'")
    await expect(card).to_contain_text("1 flight in view")
    provider = them.url.removeprefix("http://")
    await expect(card).to_contain_text(provider)

    # By its mark, in the middle of what the panels leave of the map.
    box = await page.locator("canvas.maplibregl-canvas").bounding_box()
    await page.mouse.click(box["x"] + box["width"] / 2 + 164, box["y"] + box["height"] / 2 - 64)
    await expect(card.get_by_role("heading", name="Helicopter")).to_be_visible()
    await expect(card).to_contain_text("Airborne")
    await page.evaluate(axe)
    assert await page.evaluate(barriers.FIND, barriers.TAGS) == []
    await card.get_by_role("button", name="Who flies?").click()
    await expect(card.get_by_test_id("networked-who")).to_contain_text("1581F5FKD229400A1234")
    await expect(card.get_by_test_id("networked-who")).to_contain_text("FIN87astrdge12k8")
    async with us.backend.database.read() as session:
        subjects = await session.scalars(select(AuditRow.subject).where(AuditRow.act == "read_personal_data"))
    assert [each.split("/")[0] for each in subjects] == ["networked-flight"]

    await card.get_by_role("button", name="All flights").click()
    await card.get_by_role("button", name="Helicopter").click()
    # `n` puts it away, and the back button brings it again.
    await page.keyboard.press("n")
    await expect(card).to_have_count(0)
    await page.go_back()
    await expect(card).to_be_visible()
    # An address that somebody sends shows the same to whoever opens it.
    await page.reload()
    await expect(card).to_contain_text("1 flight in view")
    assert complaints == []
