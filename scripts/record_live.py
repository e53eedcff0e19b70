"""Records what a running backend shows live, for work on the console without a backend.

    python scripts/record_live.py LINK OUT.jsonl [--seconds 60]

LINK is a sign-in link as the server prints it (`wonderland backend link`); it is used up. Each line of the recording
is `{"at_ms": since the beginning, "frame": {...}}`, the frames of docs/seams.md, "Backend to browser: live". Put it
into frontend/recordings/ and open `?source=fake:/recordings/OUT.jsonl` of `npm run dev`. A recording holds who flew
where: it does not belong into a repository.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import time
from pathlib import Path
from urllib.parse import parse_qs, urlsplit, urlunsplit

import httpx
import websockets

TIMEOUT_S = 20.0
MAX_FRAME = 64 << 20


class RecordError(Exception):
    """There is nothing to record, with what to do."""


async def sign_in(origin: str, token: str) -> str:
    """The sign-in's cookie, for a one-time token."""
    async with httpx.AsyncClient(base_url=origin, timeout=TIMEOUT_S, headers={"Origin": origin}) as client:
        answer = await client.post("/api/v1/session", json={"token": token})
    if not answer.is_success:
        raise RecordError(f"the server refused the link ({answer.status_code}); ask it for a new one")
    return "; ".join(f"{name}={value}" for name, value in answer.cookies.items())


async def record(origin: str, cookie: str, out: Path, seconds: float) -> int:
    """Write the frames of a while; returns how many."""
    address = urlunsplit(urlsplit(origin)._replace(scheme="wss" if origin.startswith("https") else "ws"))
    headers = {"Cookie": cookie, "Origin": origin}
    count = 0
    with out.open("w", encoding="utf-8") as file:
        async with websockets.connect(
            f"{address}/api/v1/live", additional_headers=headers, max_size=MAX_FRAME, open_timeout=TIMEOUT_S
        ) as socket:
            started = time.monotonic()
            try:
                async with asyncio.timeout(seconds):
                    async for text in socket:
                        at_ms = round((time.monotonic() - started) * 1000)
                        file.write(
                            json.dumps({"at_ms": at_ms, "frame": json.loads(text)}, separators=(",", ":")) + "\n"
                        )
                        count += 1
            except TimeoutError:
                pass
    return count


def main() -> int:
    """Record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("link", help="a sign-in link of the server")
    parser.add_argument("out", type=Path)
    parser.add_argument("--seconds", type=float, default=60.0)
    given = parser.parse_args()
    parts = urlsplit(given.link)
    token = parse_qs(parts.fragment).get("token", [""])[0]
    if parts.scheme not in {"http", "https"} or token == "":
        print("this is no sign-in link: it has no #token=…", file=sys.stderr)
        return 2
    origin = f"{parts.scheme}://{parts.netloc}"
    try:
        cookie = asyncio.run(sign_in(origin, token))
        count = asyncio.run(record(origin, cookie, given.out, given.seconds))
    except (RecordError, httpx.HTTPError, websockets.WebSocketException, OSError) as error:
        print(f"nothing recorded: {error}", file=sys.stderr)
        return 1
    print(f"{count} frames in {given.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
