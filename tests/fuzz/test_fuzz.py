"""A short run of each fuzzer; ``make fuzz`` is the long one."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent


def test_remote_id(tmp_path: Path) -> None:
    pytest.importorskip("atheris", reason="coverage-guided fuzzing needs atheris (extra fuzz)")
    subprocess.run([sys.executable, str(HERE / "seeds.py"), str(tmp_path / "corpus")], check=True, timeout=60)
    # libFuzzer reads its peak memory from the kernel, which counts the peak of the process that started it, too: of a
    # test worker late in a run. What one input may allocate is limited instead.
    limits = ["-rss_limit_mb=0", "-malloc_limit_mb=256"]
    command = [
        sys.executable,
        str(HERE / "fuzz_remote_id.py"),
        "-runs=6000",
        "-seed=1",
        "-max_len=1200",
        *limits,
        "corpus",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=110, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    assert "Done 6000 runs" in done.stderr or "DONE" in done.stderr
