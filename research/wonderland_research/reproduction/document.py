"""A report as one HTML file: numbered figures and tables, drawings inline, nothing loaded from anywhere."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

_STYLE: Final = """
:root { --ink: #171b1a; --quiet: #5d6664; --line: #d5dad8; --paper: #ffffff; --wash: #f4f6f5; --good: #1f6b45;
  --bad: #b3261e; --link: #0b5c7a; color-scheme: light; }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0; background: var(--paper); color: var(--ink);
  font: 16px/1.55 "Source Serif 4", "Iowan Old Style", "Palatino Linotype", Georgia, "DejaVu Serif", serif; }
main { max-width: 46rem; margin: 0 auto; padding: 3.5rem 1.25rem 5rem; }
h1, h2, h3, figcaption, caption, table, nav, .facts, .mark { font-family: Inter, "Helvetica Neue", Arial,
  "DejaVu Sans", sans-serif; }
h1 { font-size: 1.9rem; line-height: 1.2; letter-spacing: -0.01em; margin: 0 0 .5rem; }
h2 { font-size: 1.25rem; margin: 3rem 0 .75rem; padding-top: 1rem; border-top: 1px solid var(--line); }
h3 { font-size: 1rem; margin: 2rem 0 .5rem; }
p { margin: 0 0 .9rem; hyphens: auto; }
.lead { color: var(--quiet); font-size: 1.05rem; }
.facts { font-size: .8rem; color: var(--quiet); margin: 1.25rem 0 0; display: grid; gap: .15rem 1rem;
  grid-template-columns: max-content 1fr; }
.facts dt { font-weight: 600; } .facts dd { margin: 0; overflow-wrap: anywhere; }
nav { font-size: .85rem; margin: 2rem 0 0; padding: .9rem 1.1rem; background: var(--wash); border-radius: 6px; }
nav ol { margin: 0; padding-left: 1.3rem; columns: 2; column-gap: 2rem; } nav a { color: var(--link);
  text-decoration: none; }
nav a:hover { text-decoration: underline; }
figure { margin: 1.75rem 0; }
figure svg { display: block; width: 100%; height: auto; }
figcaption, caption { font-size: .82rem; line-height: 1.45; color: var(--quiet); text-align: left; }
figcaption { margin-top: .6rem; } caption { caption-side: top; margin-bottom: .5rem; }
figcaption b, caption b { color: var(--ink); }
.wide { overflow-x: auto; margin: 1.75rem 0; }
table { border-collapse: collapse; width: 100%; font-size: .8rem; line-height: 1.4;
  border-top: 1.5px solid var(--ink); border-bottom: 1.5px solid var(--ink); font-variant-numeric: tabular-nums; }
th { text-align: left; font-weight: 600; border-bottom: 1px solid var(--ink); vertical-align: bottom; }
th, td { padding: .38rem .8rem .38rem 0; vertical-align: top; } th:last-child, td:last-child { padding-right: 0; }
tbody tr + tr td { border-top: 1px solid var(--line); }
.n { text-align: right; } td.n { white-space: nowrap; }
.mark { font-weight: 600; white-space: nowrap; } .good { color: var(--good); } .bad { color: var(--bad); }
.none { color: var(--quiet); font-weight: 400; }
code { font: .84em/1.4 "JetBrains Mono", "SFMono-Regular", Consolas, "DejaVu Sans Mono", monospace; background:
  var(--wash); padding: .1em .3em; border-radius: 3px; overflow-wrap: anywhere; }
td code { font-size: .92em; padding: 0; background: none; color: var(--quiet); }
@media (max-width: 34rem) { nav ol { columns: 1; } main { padding-top: 2rem; } }
@page { margin: 18mm 16mm; }
@media print { body { font-size: 10pt; } main { max-width: none; padding: 0; } nav { display: none; }
  h2 { break-after: avoid; } figure, table tr { break-inside: avoid; } .wide { overflow: visible; }
  table { font-size: 7.8pt; } a { color: inherit; } }
"""


@dataclass(frozen=True)
class Cell:
    """A cell that is not plain text: a number to align, code, or a mark of good or bad."""

    text: str
    kind: str = ""
    """``n``, ``code``, ``good``, ``bad``, ``none`` or nothing."""


@dataclass
class Document:
    """Collects sections in order; ``html`` makes the page."""

    title: str
    lead: str
    facts: Sequence[tuple[str, str]] = ()
    _body: list[str] = field(default_factory=list)
    _sections: list[tuple[str, str]] = field(default_factory=list)
    _figures: int = 0
    _tables: int = 0

    def section(self, title: str) -> None:
        """A numbered section begins."""
        number = len(self._sections) + 1
        anchor = f"s{number}"
        self._sections.append((anchor, title))
        self._body.append(f'<h2 id="{anchor}">{number}&ensp;{html.escape(title)}</h2>')

    def heading(self, title: str) -> None:
        """A smaller heading within a section."""
        self._body.append(f"<h3>{html.escape(title)}</h3>")

    def text(self, *paragraphs: str) -> None:
        """Paragraphs of plain text; `so` is code, *so* is stressed."""
        self._body.extend(f"<p>{_inline(paragraph)}</p>" for paragraph in paragraphs)

    def figure(self, drawing: str, caption: str, *, describes: str) -> None:
        """A drawing (an SVG element). The caption's first sentence is set bold; ``describes`` is for screen readers."""
        self._figures += 1
        label = html.escape(describes, quote=True)
        drawing = _own_names(drawing, f"f{self._figures}-")
        drawing = drawing.replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
        self._body.append(
            f"<figure>{drawing}<figcaption>{_caption('Figure', self._figures, caption)}</figcaption></figure>"
        )

    def table(self, caption: str, header: Sequence[str | Cell], rows: Sequence[Sequence[str | Cell]]) -> None:
        """A table with lines above and below, as in print."""
        self._tables += 1
        head = "".join(_cell(cell, "th") for cell in header)
        body = "".join("<tr>" + "".join(_cell(cell, "td") for cell in row) + "</tr>" for row in rows)
        self._body.append(
            f'<div class="wide"><table><caption>{_caption("Table", self._tables, caption)}</caption>'
            f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
        )

    def html(self) -> str:
        """The whole page, with style and drawings inside."""
        facts = "".join(f"<dt>{html.escape(name)}</dt><dd>{_inline(value)}</dd>" for name, value in self.facts)
        contents = "".join(f'<li><a href="#{anchor}">{html.escape(title)}</a></li>' for anchor, title in self._sections)
        body = "\n".join(self._body)
        return (
            '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{html.escape(self.title)}</title><style>{_STYLE}</style></head><body><main>"
            f'<h1>{html.escape(self.title)}</h1><p class="lead">{_inline(self.lead)}</p><dl class="facts">{facts}</dl>'
            f'<nav aria-label="Contents"><ol>{contents}</ol></nav>\n{body}\n</main></body></html>\n'
        )


def _cell(cell: str | Cell, tag: str) -> str:
    if isinstance(cell, str):
        return f"<{tag}>{_inline(cell)}</{tag}>"
    if cell.kind == "code":
        return f"<{tag}><code>{html.escape(cell.text)}</code></{tag}>"
    if cell.kind == "n":
        return f'<{tag} class="n">{_inline(cell.text)}</{tag}>'
    return f'<{tag} class="mark {cell.kind}">{_inline(cell.text)}</{tag}>'


def _caption(kind: str, number: int, text: str) -> str:
    first, stop, rest = text.partition(". ")
    return f"<b>{kind} {number}. {_inline(first + (stop and '.'))}</b> {_inline(rest)}".rstrip()


def _inline(text: str) -> str:
    escaped = html.escape(text, quote=False)
    escaped = re.sub(r"`([^`]+)`", r"<code>\1</code>", escaped)
    return re.sub(r"(?<![\w*])\*([^*\s][^*]*)\*(?!\w)", r"<em>\1</em>", escaped)


def _own_names(drawing: str, prefix: str) -> str:
    """Matplotlib names its parts alike in every drawing; in one page each needs its own."""
    drawing = re.sub(r'\bid="', f'id="{prefix}', drawing)
    drawing = drawing.replace('href="#', f'href="#{prefix}').replace("url(#", f"url(#{prefix}")
    return (
        re.sub(r"<(style|metadata)\b.*?</\1>", "", drawing, count=1, flags=re.DOTALL)
        if "<metadata" in drawing
        else drawing
    )
