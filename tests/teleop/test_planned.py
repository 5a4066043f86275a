# SPDX-License-Identifier: Apache-2.0
"""What becomes of a mission that is wanted no more before its planner has answered: no browser, but its socket."""

import asyncio
import contextlib
import json
import socket
import threading
from concurrent.futures import ThreadPoolExecutor

import aiohttp
import pytest
import regista
from command_line import ROOT, Server
from gateway import Gateway
from regista import position2d
from scripted import ACK, COMMAND, REQUEST, Peer, pack

PLANNER, SET_MISSION, RUN = 44, 100, 100
MOST = 100  # s


class Slow:
    """Stands before a server, and holds the answers to SET_MISSION."""

    def __init__(self, port):
        self._port = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.robot = f"127.0.0.1:{self._listener.getsockname()[1]}"
        self.holds, self.go_on = threading.Event(), threading.Event()
        self.uploads, self.runs = [], []
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        with contextlib.suppress(OSError):  # closed
            while True:
                client = Peer(self._listener.accept()[0])
                server = Peer(socket.create_connection(("127.0.0.1", self._port)))
                threading.Thread(target=self._pass, args=(client, server, self._ask), daemon=True).start()
                client.socket.sendall(server.exactly(32))  # the banner
                threading.Thread(target=self._pass, args=(server, client, self._answer), daemon=True).start()

    @staticmethod
    def _pass(source, sink, look):
        with contextlib.suppress(OSError, EOFError):
            while True:
                message = source.next()
                look(message)
                sink.socket.sendall(pack(*message[:4], message.body, seq=message.sequence))
        sink.socket.close()

    def _ask(self, message):
        if (message.interface, message.kind, message.subtype) == (PLANNER, REQUEST, SET_MISSION):
            self.uploads.append(message.body)
        if (message.interface, message.kind, message.subtype) == (PLANNER, COMMAND, RUN):
            self.runs.append(message.body)

    def _answer(self, message):
        if (message.interface, message.kind, message.subtype) == (PLANNER, ACK, SET_MISSION):
            self.holds.set()
            self.go_on.wait(MOST)

    def close(self):
        self.go_on.set()
        self._listener.close()


class Page:
    """The socket of a page, which says that it is alive."""

    def __init__(self, stream):
        self._stream = stream
        self._asked = 0
        self._alive = asyncio.create_task(self._live())

    async def _live(self):
        while True:
            await self.say(t="alive", n=0)
            await asyncio.sleep(0.2)

    async def say(self, **message):
        await self._stream.send_json(message)

    async def hear(self, look):
        async for message in self._stream:
            said = json.loads(message.data)
            if look(said):
                return said
        raise AssertionError("the gateway has closed the socket")

    async def heard(self):
        """The gateway has taken in all that was said."""
        self._asked += 1
        n = self._asked
        await self.say(t="alive", n=n)
        await self.hear(lambda said: said["t"] == "alive" and said["n"] == n)

    async def go(self, x):
        self._asked += 1
        await self.say(t="go", n=self._asked, robot=0, device="planner:0", points=[[x, 0, None]], alone=False)
        return self._asked

    async def reply(self, n):
        return (await self.hear(lambda said: said["t"] == "reply" and said["n"] == n))["error"]

    async def close(self):
        self._alive.cancel()
        await self._stream.close()


@contextlib.asynccontextmanager
async def opened(gateway):
    """Two pages; the first has the controls."""
    origin, _, token = gateway.url.partition("/#")
    async with contextlib.AsyncExitStack() as stack:
        session = await stack.enter_async_context(aiohttp.ClientSession())
        pages = []
        for _ in range(2):
            stream = await session.ws_connect(f"{origin}/socket?token={token}", origin=origin, max_msg_size=0)
            pages.append(Page(stream))
            stack.push_async_callback(pages[-1].close)
            await pages[-1].hear(lambda said: said["t"] == "robot" and said["connected"])
        yield pages


def run(work):
    """In a thread of its own: the driver of the browser has an event loop on this one."""
    with ThreadPoolExecutor() as threads:
        return threads.submit(asyncio.run, asyncio.wait_for(work, MOST)).result()


@pytest.fixture
def slow(tmp_path):
    with Server(ROOT / "examples/field.cfg") as server, regista.Robot("127.0.0.1", server.port) as robot:
        while robot.position2d(2).count == 0:  # it is silent until it knows where it is
            robot.read(timeout=1)
        robot.position2d().request(position2d.SetMotorPower(on=1))
        proxy = Slow(server.port)
        gateway = Gateway(proxy.robot, folder=tmp_path)
        yield proxy, gateway
        gateway.end()
        proxy.close()


async def stop(pilot, other):
    await pilot.say(t="stop", n=1000)
    await pilot.heard()


async def hide(pilot, other):
    await pilot.say(t="visible", on=False)
    await pilot.heard()


async def close(pilot, other):
    await pilot.close()
    await other.hear(lambda said: said["t"] == "controls" and not said["taken"])


async def take_the_controls(pilot, other):
    await other.say(t="controls", n=1001)
    await other.heard()


@pytest.mark.parametrize("revoke", [stop, hide, close, take_the_controls])
def test_a_mission_that_is_wanted_no_more_while_it_is_uploaded_does_not_start(slow, revoke):
    proxy, gateway = slow

    async def work():
        async with opened(gateway) as (pilot, other):
            await pilot.go(100)
            assert await asyncio.to_thread(proxy.holds.wait, MOST)
            await revoke(pilot, other)
            proxy.go_on.set()
            # What would have come has come before the mission that somebody wants.
            await other.say(t="controls", n=1002)
            while await other.reply(await other.go(3)) is not None:
                pass
            while not proxy.runs:
                await other.heard()

    run(work())
    assert len(proxy.runs) == 1
    id_ = proxy.runs[0].rstrip(b"\0")[-8:]
    assert id_ in proxy.uploads[-1] and id_ not in proxy.uploads[0]


def test_the_last_destination_counts_also_right_after_another(slow):
    proxy, gateway = slow
    proxy.go_on.set()

    async def work():
        async with opened(gateway) as (pilot, _):
            assert await pilot.reply(await pilot.go(3)) is None
            assert await pilot.reply(await pilot.go(5)) is None  # before the planner was asked how far it is
            numbers = [await pilot.go(x) for x in (3, 5)]
            assert [await pilot.reply(n) for n in numbers][-1] is None
            uploads = len(proxy.uploads)
            await pilot.heard()
            return uploads

    uploads = run(work())
    assert proxy.runs[-1].rstrip(b"\0")[-8:] in proxy.uploads[uploads - 1]
