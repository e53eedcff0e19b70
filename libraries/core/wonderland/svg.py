"""Drawings made small: an SVG as matplotlib writes it says everything in many lines and to six decimals."""

from __future__ import annotations

import re
from typing import Final

_NUMBER: Final = r"-?\d+\.\d+(?:e-?\d+)?"
_PATH: Final = re.compile(r'(<path (?:id="[^"]*" )?)d="([^"]*)"')
_PLACE: Final = re.compile(rf'\b(x|y|x1|y1|x2|y2|width|height)="({_NUMBER})"|translate\(({_NUMBER}) ({_NUMBER})\)')


def compact(svg: str) -> str:
    """The same picture as one element in one line: places to a tenth, shapes that are used again to a hundredth."""
    text = svg[svg.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text, flags=re.DOTALL)
    text = _PATH.sub(lambda found: f'{found[1]}d="{_steps(found[2], 2 if "id=" in found[1] else 1)}"', text)
    text = _PLACE.sub(_place, text)
    referred = set(re.findall(r"#([\w-]+)", text))
    text = re.sub(r' id="([^"]*)"', lambda found: found[0] if found[1] in referred else "", text)
    text = re.sub(r'style="[^"]*"', lambda found: re.sub(r"([:;]) ", r"\1", found[0]), text)
    return re.sub(r"\s+", " ", re.sub(r">\s+<", "><", text)).replace(" />", "/>").strip()


def _place(found: re.Match[str]) -> str:
    if found[1]:
        return f'{found[1]}="{_rounded(found[2], 1)}"'
    return f"translate({_rounded(found[3], 1)} {_rounded(found[4], 1)})"


def _steps(path: str, decimals: int) -> str:
    rounded = re.sub(_NUMBER, lambda number: _rounded(number[0], decimals), path)
    return re.sub(r"\s*([A-Za-z])\s*", r"\1", " ".join(rounded.split()))


def _rounded(number: str, decimals: int) -> str:
    short = f"{float(number):.{decimals}f}".rstrip("0").rstrip(".")
    return "0" if short in {"-0", ""} else short
