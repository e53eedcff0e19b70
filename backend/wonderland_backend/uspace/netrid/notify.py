"""Telling subscribers of changed areas, as the DSS asks whoever changes one."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any, Final

from uas_standards.astm.f3411.v22a.constants import Scope

from wonderland_backend.http.transfer import TransferError
from wonderland_backend.uspace.peers import Peers

logger = logging.getLogger(__name__)

WAITS_S: Final = (0.0, 1.0, 5.0, 20.0)
MAX_UNDER_WAY: Final = 200


class Notifier:
    """Sends notifications in the background, a few times each."""

    def __init__(self, peers: Peers) -> None:
        self._peers = peers
        self._under_way: set[asyncio.Task[None]] = set()

    def tell_subscriber(self, url: str, area_id: str, body: Mapping[str, Any]) -> None:
        """Send an area to a subscriber. It is not waited for."""
        if len(self._under_way) >= MAX_UNDER_WAY:
            logger.warning("a subscriber was not told of an area: %d others are being told", MAX_UNDER_WAY)
            return
        task = asyncio.create_task(self._send(f"{url}/uss/identification_service_areas/{area_id}", body))
        self._under_way.add(task)
        task.add_done_callback(self._under_way.discard)

    async def close(self) -> None:
        """End what is under way."""
        for task in list(self._under_way):
            task.cancel()
        await asyncio.gather(*self._under_way, return_exceptions=True)

    async def _send(self, url: str, body: Mapping[str, Any]) -> None:
        problem = ""
        for wait_s in WAITS_S:
            await asyncio.sleep(wait_s)
            try:
                status, _, _ = await self._peers.ask("POST", url, Scope.ServiceProvider.value, json=body)
            except TransferError as error:
                problem = str(error)
                continue
            if status in {HTTPStatus.OK, HTTPStatus.NO_CONTENT}:
                return
            problem = f"it answered {status}"
            if status < HTTPStatus.INTERNAL_SERVER_ERROR and status != HTTPStatus.TOO_MANY_REQUESTS:
                break
        logger.warning("a subscriber could not be told of an area: %s", problem)
