"""Asking an RFC 3161 service for a time-stamp; the answer is checked as far as the question goes."""

from __future__ import annotations

import secrets
from typing import Any, Final

import httpx
from asn1crypto import cms, tsp

from wonderland_evidence.bundle import Bundle, TimeStamp
from wonderland_evidence.case import Case
from wonderland_evidence.errors import ExportError

QUERY_TYPE: Final = "application/timestamp-query"
REPLY_TYPE: Final = "application/timestamp-reply"
MAX_REPLY_BYTES: Final = 256 << 10
TIMEOUT_S: Final = 30.0
_GRANTED: Final = ("granted", "granted_with_mods")


async def with_timestamp(bundle: Bundle, url: str) -> Bundle:
    """The bundle with a time-stamp over the newest block that holds a transaction of its session.

    Raises `ExportError`.
    """
    number = max(place.block for place in Case(bundle).session)
    block = next(each for each in bundle.blocks if each.number == number)
    token = await ask(url, block.header.hash)
    return Bundle(
        bundle.channel,
        bundle.chaincode,
        bundle.session_id,
        bundle.blocks,
        bundle.validity,
        (*bundle.timestamps, TimeStamp(number, token)),
    )


async def ask(url: str, digest: bytes) -> bytes:
    """A token (DER) over a SHA-256 digest. Raises `ExportError`."""
    nonce = secrets.randbits(63)
    request = tsp.TimeStampReq(
        {
            "version": "v1",
            "message_imprint": {"hash_algorithm": {"algorithm": "sha256"}, "hashed_message": digest},
            "nonce": nonce,
            "cert_req": True,
        }
    )
    try:
        async with (
            httpx.AsyncClient(timeout=TIMEOUT_S, follow_redirects=False) as http,
            http.stream(
                "POST",
                url,
                content=request.dump(),
                headers={"Content-Type": QUERY_TYPE, "Accept": REPLY_TYPE, "Accept-Encoding": "identity"},
            ) as answer,
        ):
            answer.raise_for_status()
            data = await _bounded(answer)
    except (httpx.HTTPError, httpx.InvalidURL) as cause:
        raise ExportError(f"the time-stamping service {url} does not answer ({cause})") from cause
    try:
        return _token(data, digest, nonce)
    except ExportError:
        raise
    except Exception as cause:  # bytes of strangers: the ASN.1 library raises whatever it meets
        raise ExportError(f"the time-stamping service {url} answers what is no time-stamp ({cause})") from cause


async def _bounded(answer: httpx.Response) -> bytes:
    data = b""
    async for part in answer.aiter_raw():  # never unpacked: what is small packed could be gigabytes
        data += part
        if len(data) > MAX_REPLY_BYTES:
            raise ExportError(f"the time-stamping service answers more than {MAX_REPLY_BYTES} bytes")
    return data


def _token(data: bytes, digest: bytes, nonce: int) -> bytes:
    reply: Any = tsp.TimeStampResp.load(data, strict=True)
    status = reply["status"]["status"].native
    if status not in _GRANTED:
        raise ExportError(f"the time-stamping service refuses: {status}")
    token: cms.ContentInfo = reply["time_stamp_token"]
    info: Any = tsp.TSTInfo.load(token["content"]["encap_content_info"]["content"].contents)
    if info["message_imprint"]["hashed_message"].native != digest or info["nonce"].native != nonce:
        raise ExportError("the time-stamping service answers another question")
    return bytes(token.dump())
