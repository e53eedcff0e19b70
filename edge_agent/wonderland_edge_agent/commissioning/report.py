"""The report of a commissioning: one HTML file without anything outside of it, or a directory with plots beside."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from wonderland import __version__
from wonderland.proofs.records.pads import Commissioning
from wonderland_edge_agent.commissioning.clocks import Clocks
from wonderland_edge_agent.commissioning.errors import CommissioningError
from wonderland_edge_agent.commissioning.fit import Fit
from wonderland_edge_agent.commissioning.plots import draw_all
from wonderland_edge_agent.commissioning.reach import SHARE, AtDistance, Reach, ReachMap

_CSS = """
body{font:16px/1.55 system-ui,sans-serif;color:#171b1a;background:#fff}
body{max-width:68rem;margin:2.5rem auto;padding:0 1.2rem}
h1{font-size:1.7rem;margin:0 0 .2rem}h2{font-size:1.15rem;margin:2.2rem 0 .5rem}p{max-width:46rem}
.sub{color:#5d6664;margin-top:0}table{border-collapse:collapse;font-variant-numeric:tabular-nums}
td,th{padding:.28rem .9rem .28rem 0;border-bottom:1px solid #d5dad8;text-align:left;font-weight:400}
th{color:#5d6664}td.n,th.n{text-align:right}.go{color:#1f6b45;font-weight:600}.no{color:#a23b26;font-weight:600}
.note{border-left:3px solid #c9a227;padding:.1rem 0 .1rem .8rem;margin:.5rem 0}
.plots{display:flex;flex-wrap:wrap;gap:1.2rem;align-items:flex-start}.plots figure,.wide{margin:.6rem 0}
figure svg{max-width:100%;height:auto}figcaption{color:#5d6664;font-size:.88rem;max-width:32rem}
@media print{body{margin:0;max-width:none}h2{break-after:avoid}figure{break-inside:avoid}}
"""


def write_report(
    path: Path,
    fit: Fit,
    record: Commissioning,
    reaches: Sequence[Reach],
    reach_map: ReachMap,
    *,
    title: str,
    survey: Sequence[Mapping[str, Any]] = (),
    by_distance: Sequence[AtDistance] = (),
    clocks: Clocks | None = None,
    timed_reaches: Sequence[Reach] = (),
    height_reaches: Sequence[Reach] = (),
) -> Path:
    """Write ``path`` (.html), or ``path``/report.html and its plots as SVG; returns the HTML file.

    ``survey``: rows of the self-survey (anchor, off_m, sigma_m), if there was one. Raises CommissioningError.
    """
    plots = draw_all(fit, reach_map, clocks)
    timed = [] if clocks is None else _clock_part(clocks, timed_reaches, plots["clocks"])
    text = _page(fit, record, reaches, plots, title, survey, by_distance, [*_height_part(height_reaches), *timed])
    try:
        if path.suffix.lower() in {".html", ".htm"}:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
            return path
        path.mkdir(parents=True, exist_ok=True)
        for name, svg in plots.items():
            (path / f"{name}.svg").write_text(svg, encoding="utf-8")
        (path / "fit.json").write_text(json.dumps(fit.document(), indent=2) + "\n", encoding="utf-8")
        out = path / "report.html"
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CommissioningError(f"{path}: the report is not written ({error.strerror or error})") from error
    return out


def _page(
    fit: Fit,
    record: Commissioning,
    reaches: Sequence[Reach],
    plots: Mapping[str, str],
    title: str,
    survey: Sequence[Mapping[str, Any]],
    by_distance: Sequence[AtDistance],
    timed: Sequence[str],
) -> str:
    facts = fit.document()
    before, after = facts["uncalibrated_error_m"] * 100, facts["held_out_error_m"] * 100
    subtitle = (
        f"{len(fit.anchor_ids)} anchors · {fit.coverage.seconds} s of ranges with truth · "
        f"{fit.coverage.nearest_m:.1f} to {fit.coverage.furthest_m:.1f} m · Wonderland {__version__}"
    )
    about_reach = (
        f"Distances are horizontal, from the anchors' middle. There {SHARE} are verified, with bias, survey, "
        "installation and noise drawn from this commissioning. The others, and most farther out, end inconclusive: "
        "nobody is wrongly refused, nobody is let in."
    )
    about_bias = (
        "Points are means over one second, the line is the fitted table, the band what remains uncertain (1 σ). The "
        f"median error falls from {before:.1f} cm to {after:.1f} cm, measured on parts of the run that the fit did "
        "not see."
    )
    cautious = "Held-out errors of single anchors. Narrower than the curve: the stated uncertainty is cautious."
    repeated = "Rounds that repeat each other count for less. The dashed line is what the verdict reckons with."
    parts = [
        f"<h1>{html.escape(title)}</h1>",
        f'<p class="sub">{subtitle}</p>',
        "<h2>What this pad can verify</h2>",
        _reach_table(reaches),
        f"<p>{about_reach}</p>",
        "<ul>",
        *(f"<li>{html.escape(at.sentence())}</li>" for at in by_distance),
        "</ul>",
        *(f'<p class="note">{html.escape(note.text)}</p>' for note in fit.warnings),
        "<h2>Bias of each anchor by distance</h2>",
        f"<p>{about_bias}</p>",
        f'<figure class="wide">{plots["bias"]}</figure>',
        "<h2>How well it is known</h2>",
        _facts(record),
        '<div class="plots">',
        _figure(plots["residuals"], cautious),
        _figure(plots["correlation"], repeated),
        _figure(plots["coverage"], "Where the run was. Elsewhere the pad knows less than it says."),
        _figure(plots["reach"], f"Rounds by which {SHARE} are verified, by place."),
        "</div>",
    ]
    if survey:
        parts += ["<h2>The survey, checked by the anchors themselves</h2>", _survey_table(survey)]
    parts += timed
    parts += ["<h2>Bias table</h2>", _bias_table(fit)]
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width"><title>{html.escape(title)}</title>'
        f"<style>{_CSS}</style></head><body>\n{body}\n</body></html>\n"
    )


def _height_part(reaches: Sequence[Reach]) -> list[str]:
    """What the anchors tell of heights."""
    about = (
        "Where the anchors stand at different heights, or around the drone, their ranges prove the height as well. "
        "Elsewhere it stays the drone's word, and the verdict says so."
    )
    return ["<h2>Heights</h2>", _reach_table(reaches), f"<p>{about}</p>"] if reaches else []


def _clock_part(clocks: Clocks, reaches: Sequence[Reach], plot: str) -> list[str]:
    """What the clocks are good for: assurance 3."""
    about = (
        "Each point is the mean of a second of blinks: how late an anchor's time stamps are against the others', less "
        "its own mean. The points also scatter by the noise, which averages out; the band is what a verdict reckons "
        "with besides (1 σ) and does not."
    )
    notes = [f'<p class="note">{html.escape(text)}</p>' for _, text in clocks.notes()]
    rows = "".join(
        f"<tr><td>{html.escape(name)}</td><td class=n>{offset * 1000:+.0f} mm</td>"
        f"<td class=n>{sigma * 1000:.0f} mm</td></tr>"
        for name, offset, sigma in zip(clocks.anchor_ids, clocks.offset_m, clocks.sigma_m, strict=True)
    )
    verdict = (
        _reach_table(reaches, "Frames there")
        if reaches
        else '<p class="no">No-go: time stamps prove nothing at this pad.</p>'
    )
    table = (
        "<table><tr><th>Clock of</th><th class=n>Late by</th><th class=n>Uncertain by (1 σ)</th></tr>"
        f"{rows}<tr><td>Noise of one time stamp (1 σ)</td><td></td>"
        f"<td class=n>{clocks.stamp_sigma_m * 1000:.0f} mm</td></tr></table>"
    )
    return [
        "<h2>Clocks: what time stamps alone can verify (assurance 3)</h2>",
        verdict,
        *notes,
        f"<p>{about}</p>",
        f'<figure class="wide">{plot}</figure>',
        table,
    ]


def _figure(svg: str, caption: str) -> str:
    return f"<figure>{svg}<figcaption>{html.escape(caption)}</figcaption></figure>"


def _reach_table(reaches: Sequence[Reach], amount: str = "Rounds there") -> str:
    rows = [f"<table><tr><th>Buffer</th><th>In every direction</th><th class=n>{amount}</th><th>At best</th></tr>"]
    for item in reaches:
        whole = '<span class="no">no</span>' if item.everywhere_m is None else f'<span class="go">{item.span()}</span>'
        rounds = "" if item.everywhere_m is None else str(item.rounds_there)
        best = "nowhere" if item.best_m is None else f"{item.best_m:g} m"
        rows.append(f"<tr><td>±{item.buffer_m:g} m</td><td>{whole}</td><td class=n>{rounds}</td><td>{best}</td></tr>")
    return "\n".join([*rows, "</table>"])


def _facts(record: Commissioning) -> str:
    correlation = (record.correlation_ppm or 0) / 1e6
    sigmas = [point.sigma_mm for anchor in record.anchors for point in anchor.bias]
    rows = (
        ("Noise of one range (1 σ)", f"{record.range_sigma_mm} mm"),
        ("Correlation of one round with the next", f"{correlation:.2f}"),
        ("Bias common to all anchors (1 σ)", f"{record.installation_sigma_mm} mm"),
        ("Remaining bias of single anchors (1 σ)", f"{min(sigmas)} to {max(sigmas)} mm"),
        ("Survey of an anchor, each coordinate (1 σ)", f"{max(a.survey_sigma_mm for a in record.anchors)} mm"),
        ("Furthest distance that counts", f"{record.max_range_mm / 1000:.1f} m"),
    )
    return "<table>" + "".join(f"<tr><td>{name}</td><td class=n>{value}</td></tr>" for name, value in rows) + "</table>"


def _bias_table(fit: Fit) -> str:
    head = "".join(f"<th class=n>{html.escape(name)}</th>" for name in fit.anchor_ids)
    rows = [f"<table><tr><th class=n>Distance</th>{head}</tr>"]
    tables = [fit.table(index) for index in range(len(fit.anchor_ids))]
    for points in zip(*tables, strict=True):
        cells = "".join(f"<td class=n>{point.bias_mm:+d} ± {point.sigma_mm} mm</td>" for point in points)
        rows.append(f"<tr><td class=n>{points[0].range_mm / 1000:.1f} m</td>{cells}</tr>")
    return "\n".join([*rows, "</table>"])


def _survey_table(survey: Sequence[Mapping[str, Any]]) -> str:
    rows = ["<table><tr><th>Anchor</th><th class=n>Off by</th><th class=n>1 σ</th><th></th></tr>"]
    for row in survey:
        verdict = '<span class="no">check it</span>' if row["suspect"] else '<span class="go">agrees</span>'
        rows.append(
            f"<tr><td>{html.escape(str(row['anchor_id']))}</td><td class=n>{row['off_m'] * 100:.1f} cm</td>"
            f"<td class=n>{row['sigma_m'] * 100:.1f} cm</td><td>{verdict}</td></tr>"
        )
    return "\n".join([*rows, "</table>"])
