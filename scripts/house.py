"""The house by numbers, at any commit, and the drawing of its parts: ``make house``.

scripts/house.py table [COMMIT ...]     lines by part, long modules and functions, Any, …, side by side
scripts/house.py drawing [COMMIT FILE]  parts and their imports as SVG; docs/images/parts.svg unless given
scripts/house.py wheels                 build every wheel, and its size
"""

from __future__ import annotations

import ast
import itertools
import re
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parent.parent
NOW: Final = "HEAD"
LONG_MODULE: Final = 400
LONG_FUNCTION: Final = 60
SAME_RUN: Final = 8
_IMPORT: Final = re.compile(r"import |from \S+ import ")
GENERATED: Final = re.compile(
    r"tests/vectors/.*\.json|requirements/.*|frontend/package-lock\.json|compose\.yaml|docs/reference/.*|.*\.svg"
    r"|frontend/src/shared/api/schema\.d\.ts|libraries/core/wonderland/client/types\.py"
)
TEXT: Final = (".py", ".ts", ".tsx", ".css", ".md", ".json", ".svg", ".yaml", ".yml", ".toml", ".txt", ".html")
_BOX: Final = (176, 44)
_STEP: Final = (200, 92)


def git(*arguments: str) -> str:
    """What git answers."""
    return subprocess.run(["git", *arguments], capture_output=True, text=True, check=True, cwd=ROOT).stdout


@dataclass
class House:
    """The tracked files of one commit."""

    commit: str

    @cached_property
    def texts(self) -> dict[str, str]:
        """Each text file's content, by its path."""
        names = [name for name in git("ls-tree", "-r", "--name-only", self.commit).split("\n") if name.endswith(TEXT)]
        asked = "".join(f"{self.commit}:{name}\n" for name in names).encode()
        answer = subprocess.run(["git", "cat-file", "--batch"], input=asked, capture_output=True, check=True, cwd=ROOT)
        found, at = {}, 0
        for name in names:
            end = answer.stdout.index(b"\n", at)
            size = int(answer.stdout[at:end].split()[2])
            found[name] = answer.stdout[end + 1 : end + 1 + size].decode("utf-8", "replace")
            at = end + size + 2
        return found

    @cached_property
    def python(self) -> dict[str, ast.Module]:
        """Parsed modules of the product, by path; tests, scripts and migrations are none."""
        outside = ("tests/", "scripts/", "alembic/")
        return {
            name: ast.parse(text)
            for name, text in self.texts.items()
            if name.endswith(".py") and not name.startswith(outside)
        }

    def part(self, name: str) -> str:
        """The package that a module belongs to; empty for a file outside of packages."""
        parts = name.split("/")
        inside = [at for at in range(1, len(parts)) if "/".join(parts[:at]) + "/__init__.py" in self.texts]
        return parts[min(inside) - 1] if inside else ""

    @cached_property
    def lines(self) -> Counter[str]:
        """Lines by part: packages, and the top's folders; what is generated has a row of its own."""
        found: Counter[str] = Counter()
        for name, text in self.texts.items():
            top = name.split("/")[0] if "/" in name else "(top)"
            kind = "generated" if GENERATED.fullmatch(name) else (name in self.python and self.part(name)) or top
            found[kind] += text.count("\n")
        return found

    @cached_property
    def imports(self) -> dict[str, Counter[str]]:
        """For each package how many import statements name each other package."""
        packages = {part for name in self.python if (part := self.part(name))}
        found: dict[str, Counter[str]] = defaultdict(Counter)
        for name, tree in self.python.items():
            own = self.part(name)
            for node in ast.walk(tree):
                if isinstance(node, ast.ImportFrom) and not node.level:
                    named = [node.module or ""]
                elif isinstance(node, ast.Import):
                    named = [each.name for each in node.names]
                else:
                    continue
                for each in named:
                    other = each.split(".")[0]
                    if own and other in packages and other != own:
                        found[own][other] += 1
        return found

    def duplicated(self) -> int:
        """Lines within a run of SAME_RUN that stands in the product's Python elsewhere; imports do not count."""
        lines = [
            [line for raw in self.texts[name].split("\n") if (line := raw.strip()) and not _IMPORT.match(line)]
            for name in self.python
        ]
        runs: dict[tuple[str, ...], list[tuple[int, int]]] = defaultdict(list)
        for file, rows in enumerate(lines):
            for at in range(len(rows) - SAME_RUN + 1):
                runs[tuple(rows[at : at + SAME_RUN])].append((file, at))
        found = (place for places in runs.values() if len(places) > 1 for place in places)
        return len({(file, at + step) for file, at in found for step in range(SAME_RUN)})

    def count(self, pattern: str) -> int:
        """How often a pattern is in the product's Python."""
        return sum(len(re.findall(pattern, self.texts[name])) for name in self.python)

    def rows(self) -> Iterable[tuple[str, str]]:
        """The table's rows: what, and how many."""
        for part, lines in sorted(self.lines.items(), key=lambda row: -row[1]):
            yield f"lines, {part}", f"{lines:,}"
        sizes = {name: self.texts[name].count("\n") for name in self.python}
        yield f"Python modules above {LONG_MODULE} lines", str(sum(size > LONG_MODULE for size in sizes.values()))
        functions = [
            (node.end_lineno or 0) - node.lineno + 1
            for tree in self.python.values()
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        ]
        yield f"Python functions above {LONG_FUNCTION} lines", str(sum(size > LONG_FUNCTION for size in functions))
        yield "`Any`", str(self.count(r"\bAny\b"))
        yield "`type: ignore`", str(self.count(r"type: ignore"))
        yield f"duplicated lines (runs of {SAME_RUN} or more)", str(self.duplicated())
        yield "deferred imports", str(self.count(r"noqa: PLC0415"))


def table(commits: list[str]) -> None:
    """Print the rows of each commit side by side, as Markdown."""
    columns = [dict(House(commit).rows()) for commit in commits]
    names = list(dict.fromkeys(itertools.chain.from_iterable(columns)))
    names.sort(key=lambda name: not name.startswith("lines"))
    print(f"| | {' | '.join(commits)} |\n|---|{'---:|' * len(commits)}")
    for name in names:
        print(f"| {name} | {' | '.join(column.get(name, '–') for column in columns)} |")


@dataclass
class Drawing:
    """Packages in rows: each stands above whatever it imports; an arrow that follows from others is left out."""

    house: House
    places: dict[str, tuple[float, float]] = field(default_factory=dict)

    @cached_property
    def _drawn(self) -> list[tuple[str, str, int]]:
        return list(self.arrows())

    def level(self, part: str, seen: frozenset[str] = frozenset()) -> int:
        """Its row from the bottom; a circle counts once."""
        below = set(self.house.imports.get(part, ())) - seen - {part}
        return max((1 + self.level(each, seen | {part}) for each in below), default=0)

    def reaches(self, part: str, goal: str, seen: frozenset[str] = frozenset()) -> bool:
        """Whether it imports the goal by way of others."""
        below = set(self.house.imports.get(part, ())) - seen
        return goal in below or any(self.reaches(each, goal, seen | {part}) for each in below)

    def arrows(self) -> list[tuple[str, str, int]]:
        """(from, to, import statements), without those that others imply."""
        return [
            (part, other, count)
            for part, others in self.house.imports.items()
            for other, count in others.items()
            if not any(self.reaches(each, other, frozenset({part})) for each in others if each != other)
        ]

    def _place(self, row: list[str], y: float, width: float) -> None:
        """Each box above the middle of what it imports, boxes side by side, all of them within the picture."""
        goals = {part: [self.places[other][0] for start, other, _ in self._drawn if start == part] for part in row}
        wished = {part: sum(goal) / len(goal) if goal else width / 2 for part, goal in goals.items()}
        row.sort(key=lambda part: wished[part])
        middle = sum(wished.values()) / len(row)
        margin = len(row) * _STEP[0] / 2
        left = min(max(middle, margin), width - margin) - margin
        for at, part in enumerate(row):
            self.places[part] = (left + (at + 0.5) * _STEP[0], y)

    def svg(self) -> str:
        """The picture, small enough to be committed."""
        parts = sorted({part for name in self.house.python if (part := self.house.part(name))})
        rows: dict[int, list[str]] = defaultdict(list)
        for part in parts:
            rows[self.level(part)].append(part)
        width = max(map(len, rows.values())) * _STEP[0] + 24
        height = len(rows) * _STEP[1] - 28
        for level, row in sorted(rows.items()):
            self._place(row, height - 34 - level * _STEP[1], width)
        style = "text{font:13px sans-serif;text-anchor:middle;fill:#222}.n{font-size:11px;fill:#666}"
        arrow = '<marker id="a" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        out = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img">',
            f"<title>The parts and their imports</title><style>{style}</style>",
            f'<rect width="{width}" height="{height}" fill="#fff"/>',
            f'<defs>{arrow}<path d="M0 0 8 4 0 8z" fill="#777"/></marker></defs>',
            *(self._arrow(*each) for each in self._drawn),
            *(self._box(part) for part in parts),
            "</svg>\n",
        ]
        return "".join(out)

    def _arrow(self, part: str, other: str, count: int) -> str:
        """Arrows leave a box side by side, in the order of where they go, so that none passes behind another box."""
        goals = sorted(self.places[each][0] for start, each, _ in self._drawn if start == part)
        (x, y), (to_x, to_y) = self.places[part], self.places[other]
        x += _BOX[0] * ((goals.index(to_x) + 1) / (len(goals) + 1) - 0.5)
        y, to_y = y + _BOX[1] / 2, to_y - _BOX[1] / 2
        return (
            f'<path d="M{x:.0f} {y:.0f}L{to_x:.0f} {to_y:.0f}" stroke="#777" marker-end="url(#a)" fill="none">'
            f"<title>{part} imports {other}: {count}</title></path>"
        )

    def _box(self, part: str) -> str:
        x, y = self.places[part]
        lines = self.house.lines[part]
        return (
            f'<rect x="{x - _BOX[0] / 2:.0f}" y="{y - _BOX[1] / 2:.0f}" width="{_BOX[0]}" height="{_BOX[1]}" rx="4" '
            f'fill="#eef2f7" stroke="#8a99ad"/><text x="{x:.0f}" y="{y - 3:.0f}">{part}</text>'
            f'<text class="n" x="{x:.0f}" y="{y + 14:.0f}">{lines:,} lines</text>'
        )


def wheels() -> None:
    """Build every distribution, and print the sizes of the wheels."""
    projects = sorted([*ROOT.glob("libraries/*/pyproject.toml"), *ROOT.glob("*/pyproject.toml")])
    with tempfile.TemporaryDirectory() as directory:
        for project in projects:
            command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
            subprocess.run([*command, "--wheel-dir", directory, str(project.parent)], check=True)
        for wheel in sorted(Path(directory).iterdir()):
            print(f"{wheel.name:<60} {wheel.stat().st_size / 1000:>8,.0f} kB")


def main(arguments: list[str]) -> int:
    """Do what was asked; the exit code."""
    match arguments:
        case ["table", *commits]:
            table(commits or [NOW])
        case ["drawing", *rest]:
            commit, file = rest if len(rest) == 2 else (NOW, str(ROOT / "docs" / "images" / "parts.svg"))
            Path(file).write_text(Drawing(House(commit)).svg(), encoding="utf-8")
        case ["wheels"]:
            wheels()
        case _:
            print(__doc__)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
