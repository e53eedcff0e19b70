"""``wonderland evaluate --report``: drawings of judged recordings, as PNG files and as one page that loads nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from wonderland_research import evaluate_figures as figures
from wonderland_research.evaluate_delays import find_delays
from wonderland_research.evaluate_judged import HEADER, Judged, commission_first, rows
from wonderland_research.reproduction.document import Cell, Document
from wonderland_research.reproduction.machine import facts
from wonderland_research.reproduction.style import save, svg
from wonderland_simulator.recording import RecordingError

Draw = Callable[[Judged], Any]

PATH: Final = (
    "Path and estimates, seen from above. Line: the truth, or where there is none what was claimed. Dots: estimates, "
    "by outcome. Ellipses: what was measured, 95 %; the largest are left out. Triangles: anchors."
)
LIKELIHOOD: Final = (
    "Likelihood and error over time. A claim is verified above the upper line and refuted below the lower one, if that "
    "is proved as well. Below: how far the estimate is from the truth (or the claim), and the stated σ of the "
    "ellipse's long axis."
)
RESIDUALS: Final = (
    "What the ranges are off by, beyond the bias table. Medians of each window, for each anchor; band: what the "
    "commissioning states (1 σ, bias and installation). What all anchors share moves the distance, what they do not "
    "the bearing."
)
FIGURES: Final[tuple[tuple[str, Draw, str, str], ...]] = (
    ("path", figures.path, PATH, "Map of the path with estimates and their ellipses"),
    ("likelihood", figures.likelihood, LIKELIHOOD, "Likelihood and position error of each window over time"),
    ("residuals", figures.residuals, RESIDUALS, "Range residuals of each anchor by distance and over time"),
)


def write(directory: Path, found: Sequence[Judged]) -> Path:
    """Drawings and page into a directory; the page. Raises RecordingError where that cannot be written."""
    document = Document(
        "Recordings, judged",
        "Every window of recorded ranges, judged by the contract's own function as if the drone had countersigned it.",
        facts=[("Recordings", ", ".join(one.study.name for one in found)), *facts()],
    )
    document.section("Outcomes")
    document.table(
        f"Windows of {found[0].study.settings.rounds} rounds, buffer {found[0].study.settings.buffer_m:g} m. Blind: "
        "without an estimate; paper: accepted by its rule; off by: from the truth to the estimate, at its time, median "
        "and 95 %.",
        ["Recording", *(Cell(text, "n") for text in HEADER)],
        [[name, *(Cell(value, "n") for value in values)] for name, *values in rows(found)],
    )
    first = commission_first(found)
    if first:
        why, command, then = first.split("\n")
        document.text(why, f"`{command.strip()}`", f"{then.strip().capitalize()}.")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for one in found:
            _section(document, directory, one, alone=len(found) == 1)
        _calibration(document, directory, found)
        page = directory / "report.html"
        page.write_text(document.html(), encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"{directory}: the report is not written ({error.strerror or error})") from error
    return page


def _section(document: Document, directory: Path, one: Judged, *, alone: bool) -> None:
    document.section(one.study.name)
    delays = find_delays(one.study)
    if delays is not None:
        document.text(*delays.sentences())
    if not one.windows:
        document.text("Not one whole window.")
        return
    for name, draw, caption, describes in FIGURES:
        save(draw(one), directory / (f"{name}.png" if alone else f"{one.study.name}-{name}.png"))
        document.figure(svg(draw(one)), caption, describes=describes)


def _calibration(document: Document, directory: Path, found: Sequence[Judged]) -> None:
    """Only where the truth is known: whoever knows where the drone was can say how often a likelihood is right."""
    known = [one for one in found if one.study.recording.has_truth and one.windows]
    if not known:
        return
    fifths = figures.reliability(known)
    if not fifths:
        return
    document.section("Likelihood, stated and observed")
    save(figures.calibration(fifths), directory / "calibration.png")
    document.figure(
        svg(figures.calibration(fifths)),
        f"Claims at random, {figures.RANDOM_CLAIMS} for each window, evenly by area in a square of "
        f"{2 * figures.REACH_BUFFERS:g} buffers about the truth. How likely they were said to be within the buffer, "
        "and how often they were; bars are 95 % intervals of as many windows (above them) as have such claims.",
        describes="Reliability diagram of the likelihood",
    )
