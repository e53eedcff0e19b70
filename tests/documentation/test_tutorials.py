"""The tutorials, run as they are written: every block, in order, in an empty directory, against the real programs.

Sybil takes the blocks out of a page. All ```sh blocks of a page go to one bash; a ```text block after one of them is
what it has to print, where … stands for anything within a line and, alone, for any lines. Each page has a network of
its own, in which its ports are free.
"""

from __future__ import annotations

import contextlib
import os
import re
import select
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import psutil
import pytest
from kit.sitl import own_network
from sybil import Sybil
from sybil.parsers.markdown import CodeBlockParser

PAGES = Path(__file__).resolve().parents[2] / "docs" / "tutorials"
LIMIT_MIN = {"researcher": 5, "authority": 10, "pad-operator": 10, "fleet-operator": 10, "u-space-integrator": 5}
"""As promised to each (minutes, installing not counted)."""
BLOCK_S = 120
pytestmark = pytest.mark.timeout(400)


class Shell:
    """One bash, as a reader's terminal: what a block starts in the background goes on."""

    def __init__(self, directory):
        self._directory = directory
        programs = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        environment = {"PATH": programs, "HOME": str(directory), "LANG": "C.UTF-8", "PYTHONDONTWRITEBYTECODE": "1"}
        work = directory / "work"
        work.mkdir()
        self._bash = subprocess.Popen(
            ["bash", "--noprofile", "--norc"], cwd=work, env=environment, start_new_session=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        self._blocks = 0

    def run(self, block):
        """What it printed, and the first command that failed."""
        self._blocks += 1
        script, mark = self._directory / f"block-{self._blocks}.sh", f"end of block {self._blocks}: "
        script.write_text(block)
        self._bash.stdin.write(
            f"trap 'failed=${{failed:-$BASH_COMMAND}}' ERR; failed=; source {script} </dev/null; trap - ERR\n"
            f"printf '\\n{mark}%s\\n' \"${{failed@Q}}\"\n".encode()
        )
        self._bash.stdin.flush()
        printed, until = b"", time.monotonic() + BLOCK_S
        while not (end := re.search(rf"\n{mark}'(.*)'\n$".encode(), printed, re.DOTALL)):
            ready, _, _ = select.select([self._bash.stdout], [], [], max(0, until - time.monotonic()))
            more = os.read(self._bash.stdout.fileno(), 65536) if ready else b""
            assert more, f"{block}\ndid not end within {BLOCK_S} s; it printed\n{printed.decode()}"
            printed += more
        return printed[: end.start()].decode(), end[1].decode()

    def left(self):
        """Commands that still run in this terminal, but for bash itself."""
        found = []
        for process in psutil.process_iter():
            with contextlib.suppress(psutil.Error, ProcessLookupError):
                if process.pid != self._bash.pid and os.getsid(process.pid) == self._bash.pid:
                    found.append(f"{process.pid} {' '.join(process.cmdline())}")
        return found

    def close(self):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._bash.pid, signal.SIGKILL)
        self._bash.communicate()


def lines_of(text):
    """Without what is no matter: Sybil takes away a common indentation, and a space that does not break is a space."""
    text = text.replace("\N{NO-BREAK SPACE}", " ")
    return textwrap.dedent("\n".join(line.rstrip() for line in text.strip("\n").splitlines())).splitlines()


def printed_as_written(written, printed):
    """Whether it printed what the page says it does."""
    pattern = "".join(
        r"(?:.*\n)*?" if line == "…" else ".*".join(map(re.escape, line.split("…"))) + r"\n"
        for line in lines_of(written)
    )
    return re.fullmatch(pattern, "".join(f"{line}\n" for line in lines_of(printed))) is not None


class Reader:
    """Evaluates the blocks of one page."""

    def __init__(self, shell):
        self._shell, self._last, self.blocks = shell, None, 0

    def command(self, example):
        self.settled()
        self.blocks += 1
        self._last = (example.parsed, *self._shell.run(example.parsed))

    def expectation(self, example):
        assert self._last is not None, f"line {example.line}: nothing was run before it"
        block, printed, _ = self._last
        assert printed_as_written(example.parsed, printed), f"$ {block}\nprinted\n{printed}\nand not\n{example.parsed}"
        self._last = None

    def settled(self):
        """What printed nothing that the page tells has at least not failed."""
        if self._last is not None:
            block, printed, failed = self._last
            assert not failed, f"$ {block}\nprinted\n{printed}\nfailed: {failed}"


def read(page, directory):
    """Read it as somebody who types it all; the number of blocks."""
    shell = Shell(directory)
    try:
        reader = Reader(shell)
        parsers = [CodeBlockParser("sh", reader.command), CodeBlockParser("text", reader.expectation)]
        for example in Sybil(parsers=parsers).parse(page).examples():
            example.evaluate()
        reader.settled()
        assert not shell.left(), "the page leaves programs running"
        return reader.blocks
    finally:
        shell.close()


@pytest.mark.parametrize("persona", LIMIT_MIN)
def test_a_tutorial_runs_as_it_is_written(persona, tmp_path, capsys):
    began = time.monotonic()
    with own_network():
        blocks = read(PAGES / f"{persona}.md", tmp_path)
    took_min = (time.monotonic() - began) / 60
    with capsys.disabled():
        print(f"\n{persona}: {blocks} blocks, {took_min:.1f} min of {LIMIT_MIN[persona]}")
    assert blocks >= 3
    assert took_min <= LIMIT_MIN[persona]


def test_there_is_no_tutorial_that_nobody_runs():
    assert {page.stem for page in PAGES.glob("*.md")} == set(LIMIT_MIN)


GOOD = "```sh\nx=3; sleep 60 &\n```\n\n```sh\necho one $x; echo two\n```\n\n```text\none …\ntwo\n```\n\n```sh\nkill $(jobs -p); wait\n```\n"


@pytest.mark.parametrize(
    ("page", "said"),
    [
        (GOOD, ""),
        (GOOD.replace("one …\ntwo", "…\ntwo"), ""),
        (GOOD.replace("one …\ntwo", "one 4\ntwo"), "and not"),
        (GOOD.replace("one …\ntwo", "one …"), "and not"),
        (GOOD.replace("x=3;", "x=3; false;"), "failed: false"),
        ("```sh\nfalse\n```\n", "failed: false"),
        ("```sh\ntrue\nnonsense-that-is-no-command\ntrue\n```\n", "failed: nonsense"),
        (GOOD.replace("kill $(jobs -p); wait", "true"), "leaves programs running"),
        ("```text\none\n```\n", "nothing was run"),
    ],
)
def test_a_page_that_is_not_true_fails(tmp_path, page, said):
    (tmp_path / "page.md").write_text(page)
    if not said:
        assert read(tmp_path / "page.md", tmp_path) == 3
        return
    with pytest.raises(AssertionError, match=said):
        read(tmp_path / "page.md", tmp_path)
