# SPDX-License-Identifier: Apache-2.0
"""The field and the ball, as regista-vision-bridge sees them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import aiohttp

PERIOD_SECONDS = 0.05
RETRY_SECONDS = 1.0


async def watch(address: str, tell: Callable[[dict[str, Any]], None]) -> None:
    """Ask the bridge at `address`, HOST:PORT of its `status_port`, again and again, until cancelled."""
    timeout = aiohttp.ClientTimeout(total=1.0)
    field: dict[str, float] | None = None
    async with aiohttp.ClientSession(timeout=timeout) as session:
        while True:
            try:
                async with session.get(f"http://{address}/") as answer:
                    status = await answer.json(content_type=None)
            except (aiohttp.ClientError, TimeoutError, ValueError) as error:
                why = error.strerror if isinstance(error, OSError) else str(error)
                tell({"t": "vision", "why": f"no vision bridge at {address}: {why or 'it is silent'}"})
                field = None
                await asyncio.sleep(RETRY_SECONDS)
                continue
            halt = status.get("referee", {}).get("halt", False)
            message: dict[str, Any] = {"t": "vision", "why": "; ".join(status.get("warnings", [])), "halt": halt}
            if status.get("field") != field:
                field = status["field"]
                message["field"] = field
            if ball := status.get("ball"):
                message["ball"] = [ball["x_m"], ball["y_m"]]
            tell(message)
            await asyncio.sleep(PERIOD_SECONDS)
