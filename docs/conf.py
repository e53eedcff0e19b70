"""How Sphinx makes a site of these pages (``make site``; decision 0046).

The pages stay Markdown that a forge shows as well. So three things of a forge are taught to Sphinx here: ``<a id>`` is
an anchor, a link to a directory leads to its README, and the navigation is what README.md lists.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from pygments.lexers.special import TextLexer
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.transforms import SphinxTransform

project = "Wonderland"
version = release = os.environ.get("WONDERLAND_VERSION", "")
commit = os.environ.get("WONDERLAND_COMMIT", "")
copyright = (  # noqa: A001 - Sphinx's name
    f"The Wonderland authors, Apache-2.0. Of version {version}{f', commit {commit}' if commit else ''}"
)
extensions = ["myst_parser", "sphinx_copybutton"]
root_doc = "docs/README"
include_patterns = ["*.md", "docs/**", "**/README.md"]
exclude_patterns = [".github/**", "docs/conf.py"]
templates_path: list[str] = []
nitpicky = True
myst_heading_anchors = 6
highlight_language = "none"

html_theme = "furo"
html_title = f"Wonderland {version}".strip()
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_baseurl = ""
html_theme_options = {"top_of_page_buttons": []}
copybutton_selector = "div.highlight-sh pre"

NAVIGATION = ("docs/README", "docs/decisions/README")
"""Pages whose lists are the navigation: a caption for each heading, an entry for each link that begins an item."""
_ITEM = re.compile(r"^- \[(?P<text>[^\]]+)\]\((?P<path>[^)#]+)\.md\)")
_ANCHOR = re.compile(r'<a id="([^"]+)">')


def navigation(text: str) -> str:
    """The tables of contents of a page that lists others."""
    captions: dict[str, list[tuple[str, str]]] = {}
    caption = ""
    for line in text.splitlines():
        if line.startswith("## "):
            caption = line.removeprefix("## ")
        elif found := _ITEM.match(line):
            captions.setdefault(caption, []).append((found["text"], found["path"]))
    return "".join(
        f"\n```{{toctree}}\n:hidden:\n{f':caption: {caption}' if caption else ''}\n\n"
        + "".join(f"{text.replace('`', '')} <{path}>\n" for text, path in pages)
        + "```\n"
        for caption, pages in captions.items()
    )


def _add_navigation(app: Sphinx, docname: str, content: list[str]) -> None:
    del app
    if docname in NAVIGATION:
        content[0] += navigation(content[0])


class RawAnchors(SphinxTransform):
    """Links find ``<a id="…">``, which MyST takes for any HTML."""

    default_priority = 870  # before MyST resolves links within the page

    def apply(self, **_: Any) -> None:
        """Add them to the anchors that headings have."""
        slugs = getattr(self.document, "myst_slugs", {})
        for node in self.document.findall(nodes.raw):
            for anchor in _ANCHOR.findall(node.astext()):
                slugs[anchor] = (node.line or 0, anchor, anchor)
        self.env.metadata[self.env.docname]["myst_slugs"] = slugs


class DirectoryLinks(SphinxTransform):
    """A link to a directory of the repository leads to its README; without one the words stand alone."""

    default_priority = RawAnchors.default_priority

    def apply(self, **_: Any) -> None:
        """Change them to what MyST makes of a link to a page."""
        here = Path(self.env.doc2path(self.env.docname)).parent
        for node in list(self.document.findall(pending_xref)):
            place = here / node["reftarget"]
            if node.get("refdomain") or not place.is_dir():
                continue
            if (place / "README.md").is_file():
                readme = os.path.relpath(place.resolve() / "README", Path(self.env.srcdir).resolve())
                node["refdomain"], node["reftarget"], node["reftargetid"] = "doc", readme, None
            else:
                node.replace_self(node.children)


def setup(app: Sphinx) -> None:
    """Sphinx calls it."""
    app.add_lexer("csv", TextLexer)
    app.add_lexer("json-lines", TextLexer)
    app.add_transform(RawAnchors)
    app.add_transform(DirectoryLinks)
    app.connect("source-read", _add_navigation)
