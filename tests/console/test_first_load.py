"""What Lighthouse would say of the first page: the head, what is fetched and how, what moves while it comes."""

from __future__ import annotations

import re

import pytest

SCRIPTS_LIMIT = 650_000
# Below this it is good (web.dev/cls).
SHIFT_LIMIT = 0.1
TEXTS = re.compile(r"\.(?:js|mjs|css|json|svg)$")
SMALLEST = 1_024
SETTLING_MS = 3_000

WATCH_SHIFTS = """
window.__shifts = [];
new PerformanceObserver((list) => {
  for (const entry of list.getEntries()) {
    if (entry.hadRecentInput) continue;
    const sources = entry.sources.map(({ node }) => node?.outerHTML?.slice(0, 80) ?? String(node?.textContent));
    window.__shifts.push({ value: entry.value, sources });
  }
}).observe({ type: "layout-shift", buffered: true });
"""


@pytest.fixture
def first_page(real, browser):
    """Signs in, then loads the live map as a browser does that has nothing of it; returns the page and what came."""
    contexts = []

    def opened(width, height):
        context = browser.new_context(viewport={"width": width, "height": height})
        contexts.append(context)
        page = context.new_page()
        page.goto(real.link())
        page.wait_for_selector("[role=option]")
        page.close()
        page = context.new_page()
        page.context.new_cdp_session(page).send("Network.clearBrowserCache")
        page.add_init_script(WATCH_SHIFTS)
        came = []

        # Playwright wants a function of Python's own.
        def hear(response):
            came.append(response)

        page.on("response", hear)
        page.goto(f"{real.url}/#/live")
        page.wait_for_selector("[role=option]")
        page.wait_for_selector(".map-drones")
        page.wait_for_timeout(SETTLING_MS)
        return page, came

    yield opened
    for context in contexts:
        context.close()


def test_the_head_of_the_page(first_page, real):
    page, _ = first_page(1280, 800)
    assert page.title().endswith("Wonderland")
    assert page.evaluate("document.documentElement.lang") in {"en", "fi"}
    for name in ("viewport", "description", "theme-color"):
        assert page.locator(f"meta[name={name}]").first.get_attribute("content")
    assert "user-scalable=no" not in page.locator("meta[name=viewport]").get_attribute("content")
    scripts = page.eval_on_selector_all("script", "all => all.map(({ src, type }) => [src, type])")
    assert scripts
    # A module waits until the page is read; nothing comes from elsewhere, so that nothing else can hold it up.
    assert all(kind == "module" for _, kind in scripts)
    fetched = [src for src, _ in scripts]
    fetched += page.eval_on_selector_all("link", "all => all.map(({ href }) => href)")
    assert [each for each in fetched if not each.startswith(real.url)] == []
    assert (
        page.eval_on_selector_all(
            "[style*='@import'], style", "all => all.filter((e) => /@import/.test(e.textContent)).length"
        )
        == 0
    )


def test_what_the_first_map_fetches(first_page, real):
    _, came = first_page(1280, 800)
    assets = [each for each in came if each.url.startswith(f"{real.url}/assets/")]
    assert assets
    sizes = {}
    for each in assets:
        name, headers = each.url.rpartition("/")[2], each.all_headers()
        assert each.status == 200
        assert "immutable" in headers["cache-control"], name
        size = each.request.sizes()["responseBodySize"]
        if TEXTS.search(name) and size >= SMALLEST:
            assert headers.get("content-encoding") in {"br", "gzip"}, name
            assert "accept-encoding" in headers["vary"].lower(), name
        if name.endswith(("js", "mjs")):
            sizes[name] = size
    assert any("worker" in name for name in sizes)
    assert sum(sizes.values()) <= SCRIPTS_LIMIT, sizes
    page = next(each for each in came if each.url == f"{real.url}/")
    assert page.all_headers()["cache-control"] == "no-cache"
    assert [each.url for each in came if each.status >= 400] == []


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_nothing_jumps_while_it_comes(first_page, width, height):
    page, _ = first_page(width, height)
    shifts = page.evaluate("window.__shifts")
    assert sum(each["value"] for each in shifts) <= SHIFT_LIMIT, shifts
