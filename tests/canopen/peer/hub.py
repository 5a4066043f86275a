# SPDX-License-Identifier: Apache-2.0
"""A CAN bus in user space that speaks socketcand (raw mode), for machines whose kernel has no CAN.

hub.py [--port PORT] [--bus NAME] [--bit-rate BPS]    port 0: any; "PORT ready" on stdout

With a bit rate, frames pass no faster than on a real bus (worst-case stuff bits), lowest id first. Written from
doc/protocol.md of linux-can/socketcand.
"""

import argparse
import asyncio
import heapq
import itertools
import socket
import time


class Hub:
    def __init__(self, bus, bit_rate):
        self.bus = bus
        self.bit_rate = bit_rate
        self.clients = set()
        self.waiting = []
        self.order = itertools.count()
        self.arrived = asyncio.Event()

    async def serve(self, reader, writer):
        writer.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        writer.write(b"< hi >")
        text = ""
        try:
            while chunk := await reader.read(65536):
                text += chunk.decode("ascii", "replace")
                while (end := text.find(">")) >= 0:
                    words = text[text.find("<") + 1 : end].split()
                    text = text[end + 1 :]
                    self.command(words, writer)
        except (ConnectionError, ValueError, IndexError):
            pass
        self.clients.discard(writer)
        writer.close()

    def command(self, words, writer):
        match words:
            case ["open", bus]:
                writer.write(b"< ok >" if bus == self.bus else b"< error could not open bus >")
            case ["rawmode"]:
                self.clients.add(writer)
                writer.write(b"< ok >")
            case ["send", identifier, size, *data]:
                frame = bytes(int(byte, 16) for byte in data[: int(size, 16)])
                self.accept(writer, identifier.upper(), frame)
            case _:
                writer.write(b"< error unknown command >")

    def accept(self, sender, identifier, data):
        if not self.bit_rate:
            self.deliver(sender, identifier, data)
            return
        heapq.heappush(self.waiting, (int(identifier, 16), next(self.order), sender, identifier, data))
        self.arrived.set()

    def deliver(self, sender, identifier, data):
        seconds, rest = divmod(time.time_ns() // 1000, 1_000_000)
        message = f"< frame {identifier} {seconds}.{rest:06} {data.hex().upper()} >".encode()
        for client in self.clients:
            if client is not sender:
                client.write(message)

    async def pace(self):
        free = 0.0
        while True:
            while not self.waiting:
                self.arrived.clear()
                await self.arrived.wait()
            if free - time.monotonic() > 0.002:  # sleep is coarse: the mean rate is kept
                await asyncio.sleep(free - time.monotonic())
            _, _, sender, identifier, data = heapq.heappop(self.waiting)
            stuffable = (54 if len(identifier) == 8 else 34) + 8 * len(data)
            bits = stuffable + 13 + (stuffable - 1) // 4
            free = max(free, time.monotonic()) + bits / self.bit_rate
            self.deliver(sender, identifier, data)


async def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int, default=29536)
    parser.add_argument("--bus", default="can0")
    parser.add_argument("--bit-rate", type=int, default=0)
    arguments = parser.parse_args()
    hub = Hub(arguments.bus, arguments.bit_rate)
    server = await asyncio.start_server(hub.serve, "127.0.0.1", arguments.port)
    print(server.sockets[0].getsockname()[1], "ready", flush=True)
    if arguments.bit_rate:
        pacing = asyncio.create_task(hub.pace())
        await asyncio.gather(pacing, server.serve_forever())
    await server.serve_forever()


if __name__ == "__main__":
    asyncio.run(main())
