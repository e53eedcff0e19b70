"""Writes beside each image that is named here the digest that its registry has for it.

Images are those of the Dockerfile (``ARG …_IMAGE=``) and of compose.yaml (`wonderland_fabric_network.compose.IMAGES`).
Asked by skopeo; where a registry does not answer, nothing is written. A digest is never made up, nor another tag's.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parent.parent
FILES: Final = {
    ROOT / "Dockerfile": re.compile(r"(?<=_IMAGE=)(?P<tag>[\w./-]+:[\w.-]+)(?:@sha256:[0-9a-f]{64})?$", re.MULTILINE),
    ROOT / "libraries/fabric_network/wonderland_fabric_network/compose.py": re.compile(
        r'(?<=": ")(?P<tag>(?:hyperledger/fabric-\w+|postgres):[\w.-]+)(?:@sha256:[0-9a-f]{64})?(?=")'
    ),
}
_DIGEST: Final = re.compile(r"sha256:[0-9a-f]{64}")


def digest(tag: str) -> str:
    """What the registry says. Raises `LookupError`."""
    command = ["skopeo", "inspect", "--format", "{{.Digest}}", f"docker://{tag}"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    except subprocess.TimeoutExpired:
        raise LookupError(f"{tag}: its registry does not answer") from None
    said = done.stdout.strip()
    if done.returncode or not _DIGEST.fullmatch(said):
        raise LookupError(f"{tag}: {done.stderr.strip()[-300:] or 'no digest'}")
    return said


def pinned(text: str, pattern: re.Pattern[str], digests: dict[str, str]) -> str:
    """The text with the digest of each of these tags beside it."""
    return pattern.sub(lambda found: f"{found['tag']}@{digests[found['tag']]}", text)


def main() -> int:
    """Ask for all, then write; the exit code."""
    if shutil.which("skopeo") is None:
        print("skopeo is missing; Debian 12 has it: apt install skopeo", file=sys.stderr)
        return 1
    texts = {path: path.read_text() for path in FILES}
    tags = sorted({found["tag"] for path, pattern in FILES.items() for found in pattern.finditer(texts[path])})
    try:
        digests = {tag: digest(tag) for tag in tags}
    except LookupError as error:
        print(f"Nothing was written. {error}", file=sys.stderr)
        return 1
    for path, pattern in FILES.items():
        path.write_text(pinned(texts[path], pattern, digests))
    print("".join(f"{tag}@{value}\n" for tag, value in digests.items()), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
