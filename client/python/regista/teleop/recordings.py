# SPDX-License-Identifier: Apache-2.0
"""Recording what robots say, and playing it: a file that is played is served as a robot, by `regista replay`."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import re
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from regista.recording import Log, Recorder

from .link import Link

START_SECONDS = 20.0
ORDER_BYTES = 4096  # which the player has not taken yet
REPLAY = (sys.executable, "-m", "regista.cli", "replay")


class Recordings:
    """The files of one folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._running: list[tuple[Link, Path, Recorder]] = []
        self._player: asyncio.subprocess.Process | None = None
        self._following: asyncio.Task[None] | None = None

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
                path, recorder = self._create(f"{re.sub(r'[^A-Za-z0-9.]+', '-', link.label).strip('-')}-{stamp}")
                self._running.append((link, path, recorder))
                await link.record(Log(recorder))
        except BaseException:
            await self.end()
            raise

    def _create(self, stem: str) -> tuple[Path, Recorder]:
        """A second one of the same second, or of a robot whose name looks the same in a file, gets a number."""
        for number in itertools.count(1):
            path = self._folder / (f"{stem}.mcap" if number == 1 else f"{stem}-{number}.mcap")
            with contextlib.suppress(FileExistsError):
                return path, Recorder(path)
        raise AssertionError  # there is always another number

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

    async def play(self, name: str, add: Callable[[int], None], tell: Callable[[dict[str, Any]], None]) -> None:
        """Serve the recording; `add` is told the port, `tell` again and again where it is: at, length [s], rate.

        Raises ValueError when it cannot be played. One at a time: of players there is one.
        """
        await self.end_play()
        if name not in self.files():
            raise ValueError(f"there is no recording {name}")
        command = (*REPLAY, "--port", "0", "--sim", "--wait", "--steer", self._folder / name)
        pipe = asyncio.subprocess.PIPE
        player = await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe, stderr=pipe)
        self._player = player
        assert player.stderr is not None
        try:
            line = (await asyncio.wait_for(player.stderr.readline(), START_SECONDS)).decode().strip()
        except TimeoutError:
            line = f"nothing came of it for {START_SECONDS:.0f} s"
        port = line.rpartition(":")[2]
        if not line.startswith("serving ") or not port.isdecimal():
            await self.end_play()
            raise ValueError(f"{name} cannot be played: {line}")
        add(int(port))
        self._following = asyncio.get_running_loop().create_task(self._follow(player, name, tell))

    @staticmethod
    async def _follow(player: asyncio.subprocess.Process, name: str, tell: Callable[[dict[str, Any]], None]) -> None:
        assert player.stdout is not None
        async for line in player.stdout:
            tell({"file": name, **json.loads(line)})

    def steer(self, order: dict[str, float]) -> None:
        """`at`: go there [s]; `rate`: so fast, 0 for a pause. Raises ValueError when the player takes no more."""
        if self._player is not None and self._player.stdin is not None:
            if self._player.stdin.transport.get_write_buffer_size() > ORDER_BYTES:
                raise ValueError("the player does not answer: end it")
            self._player.stdin.write(json.dumps(order).encode() + b"\n")

    async def end_play(self) -> None:
        player, self._player = self._player, None
        following, self._following = self._following, None
        if following is not None:
            following.cancel()
            await asyncio.gather(following, return_exceptions=True)
        if player is not None:
            with contextlib.suppress(ProcessLookupError):
                player.terminate()
            await player.communicate()
