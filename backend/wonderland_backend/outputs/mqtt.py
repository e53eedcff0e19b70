"""MQTT: each item as JSON on a topic of its own; the last verdict of each drone stays there for who comes later."""

from __future__ import annotations

import asyncio
import logging
import ssl
from typing import Final

import aiomqtt
import orjson

from wonderland_backend.errors import SettingsError
from wonderland_backend.live.hub import Hub
from wonderland_backend.outputs import feed
from wonderland_backend.outputs.items import Gate, Item
from wonderland_backend.settings.outputs import MqttSettings

logger = logging.getLogger(__name__)

AT_LEAST_ONCE: Final = 1
PROTOCOLS: Final = {"5": aiomqtt.ProtocolVersion.V5, "3.1.1": aiomqtt.ProtocolVersion.V311}
LONGEST_PAUSE_S: Final = 30.0
TIMEOUT_S: Final = 10.0
KEEPALIVE_S: Final = 30


def topic(prefix: str, item: Item) -> str:
    """Where an item is published: ``wonderland/v1/claims/SERIAL``."""
    return f"{prefix}/v1/{item.kind}s/{item.uav_id}"


def status_topic(prefix: str) -> str:
    """Where it is said whether this server is there: ``online`` or ``offline``, retained."""
    return f"{prefix}/v1/status"


class MqttOutput:
    """Publishes until it is cancelled, and again whenever the broker has gone away."""

    def __init__(self, settings: MqttSettings, hub: Hub, instance: str) -> None:
        """Raises `SettingsError` for files that cannot be read."""
        self._settings = settings
        self._hub = hub
        self._gate = Gate(settings.tell, settings.period_ms)
        self._will = aiomqtt.Will(status_topic(settings.prefix), b"offline", AT_LEAST_ONCE, retain=True)
        self._identifier = f"wonderland-{instance[:16]}"
        self.published = 0
        try:
            self._tls = ssl.create_default_context(cafile=settings.tls_ca) if settings.tls else None
            file = settings.password_file
            self._password = file.read_text("utf-8").strip() if file is not None else None
        except (OSError, ssl.SSLError, UnicodeDecodeError) as cause:
            raise SettingsError(f"outputs.mqtt: {settings.tls_ca} or {settings.password_file}: {cause}") from cause

    async def run(self) -> None:
        """Publish while the server runs."""
        where, pause_s = f"{self._settings.host}:{self._settings.port}", 1.0
        while True:
            try:
                async with self._client() as client:
                    logger.info("MQTT: publishing at %s", where)
                    pause_s = 1.0
                    await self._publish(client)
                    return
            except (aiomqtt.MqttError, OSError) as error:
                logger.warning("MQTT: the broker %s is away (%s); trying again in %.0f s", where, error, pause_s)
            await asyncio.sleep(pause_s)
            pause_s = min(2 * pause_s, LONGEST_PAUSE_S)

    def _client(self) -> aiomqtt.Client:
        settings = self._settings
        return aiomqtt.Client(
            settings.host,
            settings.port,
            identifier=self._identifier,
            username=settings.username,
            password=self._password,
            tls_context=self._tls,
            protocol=PROTOCOLS[settings.protocol],
            keepalive=KEEPALIVE_S,
            timeout=TIMEOUT_S,
            will=self._will,
        )

    async def _publish(self, client: aiomqtt.Client) -> None:
        prefix = self._settings.prefix
        await client.publish(status_topic(prefix), b"online", AT_LEAST_ONCE, retain=True)
        async for item in feed.items(self._hub, self._gate):
            decided = item.kind == "verdict"
            quality = AT_LEAST_ONCE if decided else 0
            await client.publish(topic(prefix, item), orjson.dumps(item.to_json()), quality, retain=decided)
            self._gate.note_told(item)
            self.published += 1
        await client.publish(status_topic(prefix), b"offline", AT_LEAST_ONCE, retain=True)
