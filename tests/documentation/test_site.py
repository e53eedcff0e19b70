"""The site: built without a warning; no link leads nowhere, nothing is fetched from elsewhere, every page is found."""

from __future__ import annotations

import io
import re
import shutil
import subprocess
import sys
import tarfile
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

pytest.importorskip("sphinx", reason="make site installs what makes the site")

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "scripts" / "documentation.py"
sys.path.insert(0, str(PROGRAM.parent))
import documentation  # noqa: E402

LOADED = {
    ("script", "src"),
    ("link", "href"),
    ("img", "src"),
    ("iframe", "src"),
    ("source", "src"),
    ("video", "src"),
    ("object", "data"),
}
"""What a browser fetches without being asked to."""
pytestmark = pytest.mark.timeout(300)


class Page(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.anchors, self.links, self.loaded, self.navigation = {""}, [], [], []
        self._in_navigation = False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.anchors |= {found[name] for name in ("id", "name") if found.get(name)}
        if tag == "div":
            self._in_navigation |= found.get("class") == "sidebar-tree"
        if tag == "article":
            self._in_navigation = False
        if tag == "a" and "href" in found:
            self.links.append(found["href"])
            if self._in_navigation:
                self.navigation.append(found["href"])
        self.loaded += [found[name] for what, name in LOADED if what == tag and found.get(name)]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    to = tmp_path_factory.mktemp("site")
    done = subprocess.run([sys.executable, PROGRAM, to], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-4000:]
    return to / "html"


@pytest.fixture(scope="module")
def pages(site):
    return {path.relative_to(site).as_posix(): Page(path.read_text("utf-8")) for path in site.rglob("*.html")}


def reached(page, link):
    """The file and the anchor that a link of a page leads to."""
    parts = urlsplit(link)
    path = (Path(page).parent / unquote(parts.path)).as_posix() if parts.path else page
    steps = []
    for step in path.split("/"):
        if step == "..":
            steps.pop()
        elif step != ".":
            steps.append(step)
    return "/".join(steps), unquote(parts.fragment)


def test_no_link_leads_nowhere(site, pages):
    nowhere = []
    for name, page in pages.items():
        for link in page.links:
            if urlsplit(link).scheme:
                continue
            path, anchor = reached(name, link)
            if not (site / path).is_file() or (path in pages and anchor not in pages[path].anchors):
                nowhere.append(f"{name}: {link}")
    assert not nowhere


def test_nothing_is_fetched_from_another_host(site, pages):
    elsewhere = [
        f"{name}: {each}" for name, page in pages.items() for each in page.loaded if re.match(r"(\w+:)?//", each)
    ]
    for sheet in site.rglob("*.css"):
        elsewhere += re.findall(r"(?:url\(|@import\s)[\"']?(?:https?:)?//[^)\s]*", sheet.read_text("utf-8"))
    assert not elsewhere
    missing = [
        f"{name}: {each}"
        for name, page in pages.items()
        for each in page.loaded
        if not each.startswith("data:") and not (site / reached(name, each)[0]).is_file()
    ]
    assert not missing


def test_every_page_is_in_the_navigation_and_found_by_the_search(site, pages):
    start = "docs/README.html"
    shown = {reached(start, link)[0] for link in pages[start].navigation}
    written = {path.relative_to(ROOT).with_suffix(".html").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    assert written - {start} <= shown
    index = (site / "searchindex.js").read_text("utf-8")
    assert all(f'"{each.removesuffix(".html")}"' in index for each in written)
    assert "docs/README.html" in (site / "index.html").read_text()


def test_it_names_its_version_and_commit(site):
    from wonderland import __version__

    shown = (site / "docs/README.html").read_text("utf-8")
    assert f"Wonderland {__version__}" in shown
    assert f"Of version {__version__}" in shown
    assert documentation.commit() in shown


def test_without_git_it_names_no_commit(monkeypatch):
    monkeypatch.setenv("PATH", "")
    assert documentation.commit() == ""


def test_it_is_packed_into_the_same_bytes_each_time(site, tmp_path):
    again = tmp_path / "html"
    shutil.copytree(site, again, copy_function=shutil.copyfile)  # other times of change
    packed = []
    for html, directory in ((site, tmp_path / "one"), (again, tmp_path / "two")):
        directory.mkdir()
        documentation.pack(html, directory / "wonderland-documentation-1.tar.gz", 1_700_000_000)
        packed.append((directory / "wonderland-documentation-1.tar.gz").read_bytes())
    assert packed[0] == packed[1]
    with tarfile.open(fileobj=io.BytesIO(packed[0])) as archive:
        names = archive.getnames()
        assert {each.mtime for each in archive} == {1_700_000_000}
    assert names == sorted(names)
    assert "wonderland-documentation-1/index.html" in names
    assert len(names) == sum(path.is_file() for path in site.rglob("*"))


PLAIN = {
    "docs/README.md": "# Start\n\n## More\n\n- [Other](other.md)\n",
    "docs/other.md": '# Other\n\n<a id="raw"></a>\n\n## A heading\n\n[x](README.md#more) [y](#raw) [z](#a-heading)\n',
}


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({}, ""),
        ({"docs/other.md": "# Other\n\n[x](README.md#less)\n"}, "less"),
        ({"docs/other.md": "# Other\n\n[x](#less)\n"}, "less"),
        ({"docs/other.md": "# Other\n\n[x](gone.md)\n"}, "gone.md"),
        ({"docs/other.md": "# Other\n\n![x](gone.svg)\n"}, "gone.svg"),
        ({"docs/third.md": "# Third\n"}, "third.md"),
        (
            {"docs/README.md": "# Start\n\n- [Other](other.md)\n- [Gone](gone.md)\n", "docs/other.md": "# Other\n"},
            "gone",
        ),
    ],
)
def test_what_is_wrong_in_a_page_ends_the_build(tmp_path, changed, said):
    for name, text in (PLAIN | changed).items():
        (tmp_path / "source" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "source" / name).write_text(text)
    program = "import sys, pathlib, documentation; sys.exit(documentation.build(*map(pathlib.Path, sys.argv[1:])))"
    done = subprocess.run(
        [sys.executable, "-c", program, tmp_path / "source", tmp_path / "html"],
        cwd=PROGRAM.parent, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode == 0) is (not said), done.stderr
    assert said in done.stderr
