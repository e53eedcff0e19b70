"""Drawings are small, and still the same drawings."""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from wonderland.svg import compact

PICTURES = sorted((Path(__file__).resolve().parents[2] / "docs" / "images").glob("*.svg"))


@pytest.mark.parametrize("path", PICTURES, ids=lambda path: path.stem)
def test_the_documentation_holds_compact_drawings(path):
    text = path.read_text(encoding="utf-8")
    assert text == compact(text) + "\n"


def test_a_drawing_in_one_line_keeps_its_shapes_words_and_references():
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0, 1, 2.345], [0, 1, 4], "o-", label="lie & truth")
    axes.legend()
    out = io.StringIO()
    figure.savefig(out, format="svg")
    whole, small = out.getvalue(), compact(out.getvalue())
    assert "\n" not in small
    assert len(small) < 0.8 * len(whole)
    assert compact(small) == small
    drawn = [
        [each.tag for each in ET.fromstring(text).iter() if each.tag.endswith(("path", "use"))]
        for text in (whole, small)
    ]
    assert drawn[0] == drawn[1]
    referred = set(re.findall(r'(?:href="|url\()#([\w-]+)', small))
    assert referred
    assert referred <= set(re.findall(r' id="([^"]*)"', small))
    assert not re.findall(r'<path [^>]*clip-path[^>]* d="[^"]*\.\d\d', small)


def test_words_stay_words():
    assert compact('<?xml version="1.0"?>\n<svg>\n <text x="1.26"\n y="-0.04">a  b</text>\n</svg>\n') == (
        '<svg><text x="1.3" y="0">a b</text></svg>'
    )
