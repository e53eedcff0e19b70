"""Receivers that publish over MQTT (DroneScout, Dronetag Scout, DragonSync): JSON documents of `json_feed`'s shapes."""

from __future__ import annotations

import asyncio
import logging
import secrets
import ssl
from typing import TYPE_CHECKING, Final

import aiomqtt

from wonderland_edge_agent.receiver.errors import ReceiverError
from wonderland_edge_agent.receiver.sources.udp import deliver_json

if TYPE_CHECKING:
    from wonderland_edge_agent.receiver.settings import MqttSettings
    from wonderland_edge_agent.receiver.sources import Sink

PROTOCOLS: Final = {"5": aiomqtt.ProtocolVersion.V5, "3.1.1": aiomqtt.ProtocolVersion.V311}
AGAIN_S: Final = 1.0
LONGEST_S: Final = 30.0
MAX_QUEUED: Final = 1_000
KEEPALIVE_S: Final = 30

_log = logging.getLogger(__name__)


class MqttSource:
    """Subscribes, and again whenever the broker has gone away."""

    def __init__(self, settings: MqttSettings) -> None:
        self._settings = settings
        self._task: asyncio.Task[None] | None = None
        self.connected = asyncio.Event()

    async def start(self, sink: Sink) -> None:
        """Begin to look for the broker. Raises `ReceiverError` for files that cannot be read."""
        client = self._client()
        self._task = asyncio.create_task(self._run(client, sink))

    async def close(self) -> None:
        """Disconnect from the broker."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    def _client(self) -> aiomqtt.Client:
        settings = self._settings
        password, context = None, None
        try:
            if settings.password_file is not None:
                password = settings.password_file.read_text("utf-8").strip()
            if settings.tls_ca is not None:
                context = ssl.create_default_context(cafile=str(settings.tls_ca))
        except (OSError, ValueError) as cause:
            raise ReceiverError(f"remote_id.mqtt: {settings.password_file or settings.tls_ca}: {cause}") from cause
        return aiomqtt.Client(
            settings.host,
            settings.broker_port,
            identifier=f"wonderland-{secrets.token_hex(8)}",  # small brokers do not give one
            username=settings.username,
            password=password,
            tls_context=context,
            protocol=PROTOCOLS[settings.protocol],
            keepalive=KEEPALIVE_S,
            max_queued_incoming_messages=MAX_QUEUED,
        )

    async def _run(self, client: aiomqtt.Client, sink: Sink) -> None:
        where, wait_s = f"{self._settings.host}:{self._settings.broker_port}", AGAIN_S
        while True:
            try:
                async with client:
                    for topic in self._settings.topics:
                        await client.subscribe(topic)
                    _log.info("Remote ID: subscribed at the MQTT broker %s", where)
                    self.connected.set()
                    wait_s = AGAIN_S
                    async for message in client.messages:
                        deliver_json(sink, bytes(message.payload), f"mqtt:{message.topic}")
            except (aiomqtt.MqttError, OSError) as error:
                _log.warning("Remote ID: the MQTT broker %s is away (%s); trying again in %.0f s", where, error, wait_s)
            self.connected.clear()
            await asyncio.sleep(wait_s)
            wait_s = min(2 * wait_s, LONGEST_S)
