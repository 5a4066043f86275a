# SPDX-License-Identifier: Apache-2.0
"""Serves the page and its one WebSocket, on loopback."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import hmac
import json
import math
import secrets
import time
import traceback
from collections.abc import Awaitable, Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from aiohttp import WSCloseCode, WSMsgType, web

import regista
from regista.cli.hand import Velocity
from regista.recording import Log

from . import PAGE, vision
from .link import Link
from .mission import Point
from .recordings import Recordings

if TYPE_CHECKING:
    from .live import Foxglove, Topics

FRAMES = 60  # a second
PENDING_BYTES = 256 * 1024  # a page that is further behind gets no frames until it has caught up
RECORDING_SECONDS = 1.0  # between two tellings how large it is
STARTS = ("go", "resume", "take")
END_SECONDS = 3.0  # twice as long as a robot may owe an answer
SILENCE_SECONDS = 1.0  # a page says that it is alive five times a second; without that, nobody watches

# The page has all that it needs: nothing comes from elsewhere, nothing goes elsewhere, nobody frames it.
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; worker-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "geolocation=(), camera=(), microphone=()",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-cache",
}


class Page:
    """A browser's page, as long as its socket is open."""

    def __init__(self, socket: web.WebSocketResponse, transport: asyncio.Transport) -> None:
        self._socket = socket
        self._transport = transport
        self._queue: asyncio.Queue[str] = asyncio.Queue(1000)
        self.behind = True  # the next frame holds everything
        self.shown, self.silent = True, False
        self.heard = time.monotonic()

    @property
    def visible(self) -> bool:
        """Somebody may be looking at it."""
        return self.shown and not self.silent

    def tell(self, message: dict[str, Any]) -> None:
        self._put(to_json(message))

    def frame(self, text: str) -> None:
        self.behind = False
        self._put(text)

    @property
    def slow(self) -> bool:
        return self._transport.get_write_buffer_size() > PENDING_BYTES or self._queue.qsize() > 10

    def _put(self, text: str) -> None:
        try:
            self._queue.put_nowait(text)
        except asyncio.QueueFull:  # what it must not miss has no room
            self._transport.abort()

    async def send(self) -> None:
        while True:
            await self._socket.send_str(await self._queue.get())


class Gateway:
    """The web server and its links to robots.

    Of several pages one has the controls, the first that asked; the others look on, and may take the controls. STOP is
    everybody's.
    """

    def __init__(self, name: str, recordings: Path, live: Foxglove | None = None) -> None:
        self._live = live
        self.token = secrets.token_urlsafe(16)
        self.url = ""
        self._name = name
        self._recordings = Recordings(recordings)
        self._played: Link | None = None
        self._changing_player = asyncio.Lock()
        self._field: dict[str, float] | None = None
        self._links: dict[int, Link] = {}
        self._topics: dict[int, Topics] = {}  # of Foxglove
        self._running: dict[int, asyncio.Task[None]] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._pages: list[Page] = []
        self._pilot: Page | None = None
        self._hosts: set[str] = set()
        self._closing = False  # whoever still holds something drives no more
        self._deaf = False  # the same after STOP, until it is let go
        self._runner: web.AppRunner | None = None

    async def start(self, port: int) -> None:
        """Listen on 127.0.0.1. Raises OSError when the port is taken."""
        app = web.Application(middlewares=[self._guard])
        app.router.add_get("/", self._index)
        app.router.add_get("/socket", self._socket)
        app.router.add_static("/assets", PAGE / "assets")
        self._runner = web.AppRunner(app, access_log=None, shutdown_timeout=0.5)
        await self._runner.setup()
        site = web.TCPSite(self._runner, "127.0.0.1", port)
        await site.start()
        port = self._runner.addresses[0][1]
        self._hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self._name = f"{self._name}:{port}"
        self.url = f"http://127.0.0.1:{port}/#{self.token}"
        self._spawn(self._beat())

    def add(self, label: str, host: str, port: int) -> Link:
        """A robot; it may come later, and go."""
        topics = None if self._live is None else self._live.topics(label)
        live = None if topics is None else Log(topics)
        link = Link(max(self._links, default=-1) + 1, label, host, port, self._name[:63], self._tell, live)
        if topics is not None:
            self._topics[link.number] = topics
        self._links[link.number] = link
        self._running[link.number] = self._spawn(link.run())
        return link

    def see(self, address: str) -> None:
        """The field and the ball of the vision bridge whose `status_port` is there, HOST:PORT."""
        self._spawn(vision.watch(address, self._tell_vision))

    def _tell_vision(self, message: dict[str, Any]) -> None:
        self._field = message.get("field") or self._field
        self._tell(message)

    async def close(self) -> None:
        """Robots at rest and given back, sockets closed."""
        self._closing = True
        await asyncio.gather(*(link.close() for link in self._links.values()), return_exceptions=True)
        await self._recordings.end()
        await self._recordings.end_play()
        if self._live is not None:
            self._live.close()
        for task in self._tasks:
            task.cancel()
        with contextlib.suppress(TimeoutError):  # who still waits for a robot's answer is cancelled again, and ends
            await asyncio.wait_for(asyncio.gather(*self._tasks, return_exceptions=True), END_SECONDS)
        if self._runner is not None:
            await self._runner.cleanup()

    def _spawn(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def _tell(self, message: dict[str, Any]) -> None:
        for page in self._pages:
            page.tell(message)

    # The web

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Only who meant this server: a foreign page that resolves its own name to 127.0.0.1 says another Host."""
        if request.host not in self._hosts:
            raise web.HTTPForbidden(text="wrong Host\n")
        response = await handler(request)
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    async def _index(self, request: web.Request) -> web.StreamResponse:
        return web.FileResponse(PAGE / "index.html", headers=HEADERS)

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        if request.headers.get("Origin") not in {f"http://{host}" for host in self._hosts}:
            raise web.HTTPForbidden(text="wrong Origin\n")
        if not hmac.compare_digest(request.query.get("token", "").encode(), self.token.encode()):
            raise web.HTTPForbidden(text="wrong token: open the address that regista teleop printed\n")
        socket = web.WebSocketResponse(max_msg_size=256 * 1024, compress=False, timeout=1.0)
        await socket.prepare(request)
        page = Page(socket, cast(asyncio.Transport, request.transport))
        self._enter(page)
        sending = asyncio.get_running_loop().create_task(page.send())
        try:
            async for message in socket:
                if message.type is not WSMsgType.TEXT:
                    break
                page.heard = time.monotonic()
                page.silent = False
                await self._take(page, message.data)
        except ConnectionError:
            pass
        finally:
            sending.cancel()
            self._leave(page)
            with contextlib.suppress(ConnectionError, asyncio.CancelledError):
                await sending
        await socket.close(code=WSCloseCode.GOING_AWAY)
        return socket

    def _enter(self, page: Page) -> None:
        self._pages.append(page)
        page.tell({"t": "hello", "name": self._name[:63]})
        if self._field is not None:
            page.tell({"t": "vision", "why": "", "field": self._field})
        page.tell({"t": "playable", "files": self._recordings.files()})
        page.tell({"t": "recording", **self._recordings.to_dict()})
        for link in self._links.values():
            for message in link.state.values():
                page.tell(message)
        if self._pilot is None:
            self._pilot = page
        self._tell_pilot()

    def _leave(self, page: Page) -> None:
        self._pages.remove(page)
        if page is self._pilot:
            self._pilot = None
            self._deaf = False
            self._abandon("the page was closed")
        self._tell_pilot()

    def _tell_pilot(self) -> None:
        for page in self._pages:
            page.tell({"t": "controls", "yours": page is self._pilot, "taken": self._pilot is not None})

    def _abandon(self, reason: str) -> None:
        for link in self._links.values():
            link.let_go()
            self._spawn(link.page_gone(reason))

    # What pages say

    async def _take(self, page: Page, text: str) -> None:
        try:
            message = json.loads(text)
            type_ = message["t"]
            if type_ == "drive":  # fifty times a second: no answer
                if page is self._pilot and page.visible and not (self._deaf or self._closing):
                    self._link(message).hold(message["device"], _velocity(message))
                return
            if type_ == "release":
                if page is self._pilot:
                    self._deaf = False
                    for link in self._links.values():
                        link.let_go()
                return
            if type_ == "alive":
                page.tell({"t": "alive", "n": message["n"]})
                return
            if type_ == "visible":
                self._see(page, bool(message["on"]))
                return
        except (KeyError, TypeError, ValueError, regista.Error):
            return  # what is no command moves nothing
        self._spawn(self._answer(page, message))

    def _see(self, page: Page, visible: bool) -> None:
        page.shown = visible
        if not visible and page is self._pilot:
            self._abandon("the page is hidden")

    async def _answer(self, page: Page, message: dict[str, Any]) -> None:
        error = None
        try:
            await self._do(page, message)
        except (regista.Error, ValueError, OSError) as problem:
            error = str(problem)
        except (KeyError, TypeError) as problem:
            error = f"{message['t']}: {problem!r}"
        page.tell({"t": "reply", "n": message.get("n"), "error": error})

    async def _do(self, page: Page, message: dict[str, Any]) -> None:
        type_ = message["t"]
        if type_ == "stop":
            self._deaf |= any(link.held for link in self._links.values())
            self._tell({"t": "stopped"})
            links = [self._link(message)] if message.get("robot") is not None else list(self._links.values())
            done = await asyncio.gather(*(link.stop() for link in links), return_exceptions=True)
            for link, problem in zip(links, done, strict=True):
                # Of a robot that is not there, the page says so already.
                if isinstance(problem, BaseException) and not isinstance(problem, regista.ConnectionError):
                    link.note(f"STOP: {problem}", severity=2)
            return
        if type_ == "controls":
            if self._pilot is not page:
                self._abandon("another page took the controls")
                self._pilot = page
                self._deaf = False
                self._tell_pilot()
            return
        if type_ == "record":
            await self._record(bool(message["on"]))
            return
        if type_ == "play":
            name = str(message["file"])
            async with self._changing_player:
                await self._end_play()
                await self._recordings.play(name, functools.partial(self._add_player, name), self._tell_play)
            return
        if type_ == "end_play":
            async with self._changing_player:
                await self._end_play()
            return
        if type_ == "steer":
            self._recordings.steer({key: _number(message[key]) for key in ("at", "rate") if key in message})
            return
        if page is not self._pilot:
            raise ValueError("another page has the controls: take them first")
        if type_ in STARTS and (self._closing or not page.visible):
            raise ValueError("nothing starts while nobody watches")
        link = self._link(message)
        device = message["device"]
        if type_ == "go":
            await link.go(device, [_point(point) for point in message["points"]], alone=bool(message["alone"]))
        elif type_ == "pause":
            await link.pause(device)
        elif type_ == "resume":
            await link.resume(device, alone=bool(message["alone"]))
        elif type_ == "cancel":
            await link.cancel(device)
        elif type_ == "take":
            await link.take(device)
        elif type_ == "give":
            await link.give(device)
        elif type_ == "motors":
            await link.motors(device, bool(message["on"]))
        elif type_ == "odometry":
            await link.odometry(device, *(_number(value) for value in message["pose"]))
        elif type_ == "kick":
            await link.kick(device, message["action"], _number(message["speed"]), _number(message.get("angle", 0)))
        elif type_ == "outputs":
            await link.outputs(device, int(message["count"]), int(message["bits"]))
        else:
            raise ValueError(f"no such request: {type_}")

    async def _record(self, on: bool) -> None:
        if on:
            await self._recordings.start(link for link in self._links.values() if link is not self._played)
        else:
            await self._recordings.end()
        self._tell({"t": "recording", **self._recordings.to_dict()})
        self._tell({"t": "playable", "files": self._recordings.files()})

    def _tell_play(self, where: dict[str, Any]) -> None:
        if self._played is not None:
            self._tell({"t": "playing", "robot": self._played.number, **where})

    def _add_player(self, name: str, port: int) -> None:
        self._played = self.add(name, "127.0.0.1", port)

    async def _end_play(self) -> None:
        link, self._played = self._played, None
        if link is not None:
            del self._links[link.number]
            task = self._running.pop(link.number)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            if link.number in self._topics:
                self._topics.pop(link.number).close()
            self._tell({"t": "gone", "robot": link.number})
        await self._recordings.end_play()

    def _link(self, message: dict[str, Any]) -> Link:
        link = self._links.get(message["robot"])
        if link is None:
            raise ValueError("there is no such robot")
        return link

    # Sixty times a second

    async def _beat(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        told = 0.0
        while True:
            due = max(due + 1 / FRAMES, loop.time())
            await asyncio.sleep(due - loop.time())
            pilot = self._pilot
            watched = pilot is not None and pilot.visible
            for link in self._links.values():
                try:
                    link.tick(watched=watched)
                except Exception:  # one robot must not end the beat of all
                    traceback.print_exc()
            now = time.monotonic()
            if pilot is not None and pilot.visible and now - pilot.heard > SILENCE_SECONDS:
                pilot.silent = True
                self._abandon("the page is silent")
            self._frames(now)
            if self._recordings.running and now - told > RECORDING_SECONDS:
                told = now
                self._tell({"t": "recording", **self._recordings.to_dict()})

    def _frames(self, now: float) -> None:
        pages = [page for page in self._pages if page.visible and not page.slow]
        for page in self._pages:
            page.behind = page.behind or page not in pages
        if not pages:
            return
        news: str | None = None
        everything: str | None = None
        # The newest of each stream is enough, so that whoever was left out gets all.
        if any(page.behind for page in pages):
            everything = self._frame(now, again=True)
        if any(not page.behind for page in pages):
            news = everything if everything is not None else self._frame(now, again=False)
        for page in pages:
            text = everything if page.behind else news
            if text is not None:
                page.frame(text)

    def _frame(self, now: float, *, again: bool) -> str | None:
        robots = [[link.number, rows] for link in self._links.values() if (rows := link.news(now, again=again))]
        if not robots and not again:
            return None
        return to_json({"t": "frame", "at": round(now, 4), "robots": robots})


def to_json(message: Any) -> str:
    """As browsers read it: what is no finite number is null."""
    try:
        return json.dumps(message, separators=(",", ":"), allow_nan=False)
    except ValueError:
        return json.dumps(_finite(message), separators=(",", ":"), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _number(value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError("not a finite number")
    return number


def _velocity(message: dict[str, Any]) -> Velocity:
    return Velocity(_number(message["x"]), _number(message["y"]), _number(message["w"]))


def _point(values: list[Any]) -> Point:
    x, y, heading = values
    return Point(_number(x), _number(y), None if heading is None else _number(heading))
