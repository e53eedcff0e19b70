"""TLS that ends at the server: which versions and suites it speaks."""

from __future__ import annotations

import asyncio
import contextlib
import ssl

import pytest
import trustme

from wonderland_backend.listening import Listen
from wonderland_backend.serve import new_server
from wonderland_backend.settings import Settings


@pytest.fixture
async def dial(tmp_path):
    """Connects as a client that is bent to its wishes; gives the suite that came about."""
    ca = trustme.CA()
    path = tmp_path / "own.pem"
    ca.issue_cert("localhost").private_key_and_cert_chain_pem.write_to_path(path)
    server = new_server(lambda *_: None, Settings(public_url="https://localhost", tls_certificate=path))

    with contextlib.closing(Listen("127.0.0.1", 0).open()) as bound:
        task = asyncio.create_task(server.serve([bound]))
        while not server.started:
            await asyncio.sleep(0.005)

        async def connect(**wishes):
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
            ca.configure_trust(context)
            context.set_ciphers(wishes.pop("suites", "DEFAULT"))
            for name, value in wishes.items():
                setattr(context, name, value)
            port = bound.getsockname()[1]
            _, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context, server_hostname="localhost")
            writer.close()
            return writer.get_extra_info("cipher")[0]

        yield connect
        server.should_exit = True
        await task


async def test_1_3_is_preferred_and_1_2_has_authenticated_encryption(dial):
    assert (await dial()).startswith("TLS_")
    old = ssl.TLSVersion.TLSv1_2
    assert (await dial(maximum_version=old)) in {"ECDHE-ECDSA-AES256-GCM-SHA384", "ECDHE-ECDSA-AES128-GCM-SHA256"}


@pytest.mark.parametrize("suites", ["ECDHE+AES:!AESGCM:!AESCCM", "AES128-GCM-SHA256", "aNULL:eNULL:@SECLEVEL=0", "PSK"])
async def test_weaker_suites_are_refused(dial, suites):
    with pytest.raises((ssl.SSLError, ConnectionError)):
        await dial(maximum_version=ssl.TLSVersion.TLSv1_2, suites=suites)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1, ssl.TLSVersion.TLSv1_1])
async def test_older_versions_are_refused(dial, version):
    with pytest.raises((ssl.SSLError, ConnectionError)):
        await dial(minimum_version=version, maximum_version=version, suites="ALL:@SECLEVEL=0")
