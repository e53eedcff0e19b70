"""The house keeps its promises: references are fresh, layers hold, help teaches."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("script", "page"),
    [
        ("records_reference.py", "records.md"),
        ("ingest_reference.py", "ingest.md"),
        ("settings_reference.py", "settings.md"),
        ("commands_reference.py", "commands.md"),
        ("problems_reference.py", "problems.md"),
        ("metrics_reference.py", "metrics.md"),
        ("events_reference.py", "events.md"),
        ("rest_reference.py", "rest.md"),
    ],
)
def test_references_are_fresh(tmp_path, script, page):
    subprocess.run([sys.executable, str(ROOT / "scripts" / script), str(tmp_path / page)], check=True, cwd=ROOT)
    assert (tmp_path / page).read_text() == (ROOT / "docs/reference" / page).read_text(), "run: make docs"


@pytest.mark.parametrize(
    "command", ["demo", "simulate", "reproduce", "ledger", "backend", "pad", "uav", "uwb", "ros1", "ros2"]
)
def test_each_command_explains_itself(command):
    done = subprocess.run(
        [sys.executable, "-m", "wonderland.cli", command, "--help"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert len(done.stdout) > 200


def test_no_merge_was_left_half_done():
    marks = ["-e", "^<{7} ", "-e", "^>{7} ", "-e", "^={7}$"]
    found = subprocess.run(["git", "grep", "-lE", *marks], capture_output=True, text=True, cwd=ROOT, check=False)
    assert found.returncode == 1, found.stdout + found.stderr  # 1: nothing found


def test_links_in_the_documentation_lead_somewhere():
    broken = []
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *ROOT.glob("docs/**/*.md")]:
        targets = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text())
        broken += [f"{page.relative_to(ROOT)}: {target}" for target in targets if not (page.parent / target).exists()]
    assert not broken


def test_a_pad_needs_no_web_stack_and_no_numbers():
    """What `wonderland pad run` imports stays light: the whole agent has to fit into 60 MB."""
    program = (
        "import sys, wonderland_edge_agent.agent_commands, wonderland_edge_agent.assembly, wonderland_edge_agent.agent; "
        "print(sorted({'fastapi','sqlalchemy','uvicorn','numpy','scipy','pyproj','matplotlib','pydantic'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_modules_of_the_console_differ_by_more_than_case():
    """Where a disk ignores case (macOS, Windows), an import of one of them would find the other."""
    found = [path.with_suffix("") for path in (ROOT / "frontend/src").rglob("*.ts*")]
    names = [str(path).lower() for path in found]
    assert not sorted(str(path) for path in found if names.count(str(path).lower()) > 1)


def test_no_lock_names_where_packages_come_from():
    for lock in [*ROOT.glob("requirements/*.txt"), ROOT / "frontend" / "package-lock.json"]:
        text = lock.read_text()
        assert "--index-url" not in text
        assert '"resolved"' not in text
        assert not re.search(r"@ https?://", text)
