# SPDX-License-Identifier: Apache-2.0
"""Recording what robots say, and playing it: a file that is played is served as a robot, by `regista replay`."""

from __future__ import annotations

import asyncio
import contextlib
import re
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from regista.recording import Log, Recorder

from .link import Link

START_SECONDS = 20.0


class Recordings:
    """The files of one folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._running: list[tuple[Link, Path, Recorder]] = []
        self._player: asyncio.subprocess.Process | None = None

    @property
    def running(self) -> bool:
        return bool(self._running)

    def files(self) -> list[str]:
        """What can be played, the newest first."""
        found = [(path.stat().st_mtime, path.name) for path in self._folder.glob("*.mcap") if path.is_file()]
        return [name for _, name in sorted(found, reverse=True)[:50]]

    async def start(self, links: Iterable[Link]) -> None:
        """One file for each robot. Raises OSError when one cannot be made."""
        if self._running:
            return
        stamp = time.strftime("%Y%m%d-%H%M%S")
        try:
            for link in links:
                path = self._folder / f"{re.sub(r'[^A-Za-z0-9.]+', '-', link.label)}-{stamp}.mcap"
                recorder = Recorder(path)
                self._running.append((link, path, recorder))
                await link.record(Log(recorder))
        except BaseException:
            await self.end()
            raise

    async def end(self) -> None:
        running, self._running = self._running, []
        for link, _, _ in running:
            await link.record(None)
        for _, _, recorder in running:
            await asyncio.get_running_loop().run_in_executor(None, recorder.close)

    def to_dict(self) -> dict[str, Any]:
        """For the page."""
        troubles = [recorder.trouble.strerror for _, _, recorder in self._running if recorder.trouble is not None]
        return {
            "files": [path.name for _, path, _ in self._running],
            "bytes": sum(recorder.size for _, _, recorder in self._running),
            "dropped": sum(recorder.dropped for _, _, recorder in self._running),
            "trouble": troubles[0] if troubles else "",
        }

    async def play(self, name: str, add: Callable[[int], None]) -> None:
        """Serve the recording; `add` is told the port. Raises ValueError when it cannot be played."""
        await self.end_play()
        if name not in self.files():
            raise ValueError(f"there is no recording {name}")
        self._player = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "regista.cli", "replay", "--port", "0", "--sim", "--wait", self._folder / name),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
        )
        assert self._player.stderr is not None
        line = (await asyncio.wait_for(self._player.stderr.readline(), START_SECONDS)).decode().strip()
        port = line.rpartition(":")[2]
        if not line.startswith("serving ") or not port.isdecimal():
            await self.end_play()
            raise ValueError(f"{name} cannot be played: {line}")
        add(int(port))

    async def end_play(self) -> None:
        player, self._player = self._player, None
        if player is not None:
            with contextlib.suppress(ProcessLookupError):
                player.terminate()
            await player.communicate()
