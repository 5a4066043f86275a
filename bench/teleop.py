# SPDX-License-Identifier: Apache-2.0
"""The page of `regista teleop` with twelve robots: its frames, the gateway's share of a core, and how long a key takes.

python bench/teleop.py [--robots N] [--seconds S]

Wants the packages of tests/teleop/requirements.txt, the server in $REGISTA_BIN (build/dev/bin), and Chromium.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import socket
import statistics
import sys
import threading
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

ROOT = Path(__file__).resolve().parents[1]
sys.path += [str(ROOT / "tests/cli"), str(ROOT / "tests/teleop")]

from command_line import Server  # noqa: E402
from gateway import Gateway  # noqa: E402

COMMAND = bytes([0, 0, 0, 2])  # the type of a header, behind host, robot, interface and index
FRAMES = "let n = 0; const f = () => { n++; requestAnimationFrame(f); }; f(); window.frames_drawn = () => n;"
STAMP = """
addEventListener("keydown", (e) => { window.at = performance.timeOrigin + e.timeStamp; }, true);
addEventListener("keyup", (e) => { window.at = performance.timeOrigin + e.timeStamp; }, true);
"""


class Tap:
    """Between gateway and server; knows when the last command went by, by the wall clock [s]."""

    def __init__(self, port: int) -> None:
        self.server = port
        self.commands: list[float] = []
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.robot = f"127.0.0.1:{self.listener.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            near, _ = self.listener.accept()
            far = socket.create_connection(("127.0.0.1", self.server))
            for end in (near, far):
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            threading.Thread(target=self._pump, args=(near, far, True), daemon=True).start()
            threading.Thread(target=self._pump, args=(far, near, False), daemon=True).start()

    def _pump(self, source: socket.socket, sink: socket.socket, watch: bool) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                if watch and data[16:20] == COMMAND:
                    self.commands.append(time.time())
                sink.sendall(data)
        sink.close()


def usage(pid: int) -> tuple[float, float]:
    """CPU time [s] and resident memory [MB]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"), pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def busy(inspector) -> float:
    """CPU time [s] of the page's main thread."""
    metrics = inspector.send("Performance.getMetrics")["metrics"]
    return next(metric["value"] for metric in metrics if metric["name"] == "TaskDuration")


def latencies(page, tap: Tap) -> list[float]:
    """[ms] from a key's event to the command that it caused."""
    found = []
    for _ in range(30):
        page.wait_for_timeout(300)
        before = len(tap.commands)
        page.keyboard.down("w")
        end = time.monotonic() + 5
        while len(tap.commands) == before:
            if time.monotonic() > end:
                raise RuntimeError("no command came of a key within 5 s: has the page lost the robot?")
            page.wait_for_timeout(5)
        found.append((tap.commands[before] - page.evaluate("window.at") / 1e3) * 1e3)
        page.keyboard.up("w")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=12)
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    with contextlib.ExitStack() as stack:
        servers = [stack.enter_context(Server(ROOT / "examples/sim.cfg")) for _ in range(options.robots)]
        tap = Tap(servers[0].port)
        gateway = Gateway(tap.robot, *(server.robot for server in servers[1:]), folder=Path("/tmp"))
        stack.callback(gateway.end)
        playwright = stack.enter_context(sync_playwright())
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = playwright.chromium.launch(
            executable_path=os.environ.get("CHROMIUM", "/usr/bin/chromium"), args=arguments
        )
        stack.callback(browser.close)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.add_init_script(FRAMES + STAMP)
        page.goto(gateway.url)
        page.locator(".chip:not(.lost)").nth(options.robots - 1).wait_for()
        page.wait_for_timeout(2000)
        inspector = page.context.new_cdp_session(page)
        inspector.send("Performance.enable", {"timeDomain": "threadTicks"})
        page_before = busy(inspector)
        drawn, cpu, memory, began = page.evaluate("frames_drawn()"), *usage(gateway.process.pid), time.monotonic()
        page.wait_for_timeout(options.seconds * 1e3)
        seconds = time.monotonic() - began
        frames = (page.evaluate("frames_drawn()") - drawn) / seconds
        page_share = (busy(inspector) - page_before) / seconds * 100
        spent, memory_after = usage(gateway.process.pid)
        key = latencies(page, tap)
        load = os.getloadavg()[0]
        print(f"{options.robots} robots, {os.cpu_count()} cores, load {load:.1f}")
        print(f"page     {frames:.0f} frames/s, its main thread {page_share:.0f} % of a core")
        share = (spent - cpu) / seconds * 100
        print(f"gateway  {share:.0f} % of a core, {memory:.0f} MB, {memory_after:.0f} MB at the end")
        print(f"key to command  p50 {statistics.median(key):.1f} ms, max {max(key):.1f} ms")


if __name__ == "__main__":
    main()
