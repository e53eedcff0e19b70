"""A browser at the follower shows the live map, and goes on when the other backend dies. WONDERLAND_SCREENS keeps pictures."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from kit.browser import COARSE_CANVAS, FLAGS, OFFLINE, PATIENCE_MS, chromium_on_path
from kit.replicas import cookie
from playwright.async_api import async_playwright, expect

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(240),
    pytest.mark.parametrize("database_url", ["sqlite"], indirect=True),
    pytest.mark.skipif(chromium_on_path() is None, reason="Chromium is not installed"),
]


async def keep(page, name):
    if directory := os.environ.get("WONDERLAND_SCREENS"):
        Path(directory).mkdir(parents=True, exist_ok=True)
        await page.wait_for_timeout(1_500)
        await page.screenshot(path=Path(directory) / f"{name}.png")


async def test_the_map_at_a_follower(replicas, field):
    first = await replicas.begin("backend-1")
    token = (await first.told())["token"]
    second = await replicas.begin("backend-2")
    await second.told()
    name, _, value = (await cookie(first.url, token)).partition("=")
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=chromium_on_path(), args=[*FLAGS, OFFLINE])
        context = await browser.new_context(viewport={"width": 1280, "height": 800})
        await context.add_init_script(COARSE_CANVAS)
        await context.add_cookies([{"name": name, "value": value, "url": second.url}])
        page = await context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        expect.set_options(timeout=PATIENCE_MS)
        async with field.reporting(first.url):
            await field.prove()
            await page.goto(second.url)
            await expect(page.locator(".header")).to_contain_text("up to date")
            await page.evaluate("window.mark = 'never loaded again'")
            await field.prove()
            await keep(page, "follower")
            verdicts = page.get_by_text("efuted")
            await expect(verdicts.first).to_be_visible()
            before = await verdicts.count()
        first.stop()
        await expect(page.locator(".banner")).to_contain_text("hears nothing of the one on duty")
        await keep(page, "follower-stale")
        first.process.kill()
        first.go_on()
        assert (await second.told())["ready"] is True
        async with field.reporting(second.url):
            await expect(page.locator(".banner")).to_have_count(0)
            await field.prove()
            await page.wait_for_function(
                "([text, least]) => document.body.innerText.split(text).length - 1 > least", arg=["efuted", before - 1]
            )
            await keep(page, "follower-took-over")
            assert await page.evaluate("window.mark") == "never loaded again"
        await browser.close()
