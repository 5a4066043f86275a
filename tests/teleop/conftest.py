# SPDX-License-Identifier: Apache-2.0
"""A simulated robot, `regista teleop`, and a real browser that drives it."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tests/cli"))

from command_line import Server  # noqa: E402
from gateway import Gateway, serving  # noqa: E402

AXE = os.environ.get("AXE")
VIEW = {"width": 1280, "height": 800}


@pytest.fixture(scope="session")
def browser():
    with sync_playwright() as playwright:
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        program = os.environ.get("CHROMIUM", "/usr/bin/chromium")
        browser = playwright.chromium.launch(executable_path=program, args=arguments)
        browser.new_page().close()  # the first one takes seconds
        yield browser
        browser.close()


@pytest.fixture
def robot():
    """A server with a simulated robot."""
    with Server(ROOT / "examples/sim.cfg") as server:
        yield server


@pytest.fixture(scope="session")
def shared(tmp_path_factory):
    """A robot and its gateway, for tests that leave both as they were, but for where the robot is."""
    with serving("sim.cfg", tmp_path_factory.mktemp("recordings")) as both:
        yield both


@pytest.fixture
def start(tmp_path):
    """Start a gateway for these servers."""
    gateways = []

    def start_one(*servers):
        gateways.append(Gateway(*(server.robot for server in servers), folder=tmp_path))
        return gateways[-1]

    yield start_one
    for gateway in gateways:
        gateway.end()


@pytest.fixture
def visit(browser):
    """Open the page in a browser of its own, and wait until it shows a robot that stands."""
    contexts = []

    def open_page(gateway, *, ready=True, script="", **options):
        context = browser.new_context(viewport=VIEW, **options)
        contexts.append(context)
        context.set_default_timeout(20_000)
        page = context.new_page()
        page.troubles = []
        page.on("console", lambda m: page.troubles.append(m.text) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: page.troubles.append(str(error)))
        if script:
            page.add_init_script(script)
        page.goto(gateway.url)
        if ready:
            page.locator("#state", has_text="STOPPED").wait_for()
        return page

    yield open_page
    for context in contexts:
        context.close()


@pytest.fixture
def accessible():
    """What axe finds in a page as it stands, dark and light, is an error; the page is left as it was."""

    def check(page):
        if AXE is None:
            return
        page.evaluate(Path(AXE).read_text())
        found = []
        for _ in range(2):
            found += page.evaluate(
                "axe.run().then(r => r.violations.map(v => [document.documentElement.dataset.theme, v.id,"
                " v.nodes.map(n => n.target.join(' ') + ': ' + n.failureSummary)]))"
            )
            page.locator("#theme").click()
        assert found == []

    return check
