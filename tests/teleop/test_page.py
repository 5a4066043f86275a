# SPDX-License-Identifier: Apache-2.0
"""Who may talk to the gateway, and whether everybody can use the page."""

import http.client
import os
import subprocess
import sys
import urllib.error
import urllib.request

import pytest
from command_line import REGISTA, ROOT, Server, environment, run


def status(url, **headers):
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=10) as answer:
            return answer.status, answer.headers
    except urllib.error.HTTPError as error:
        return error.code, error.headers


def upgrade(gateway, token, origin):
    """What the WebSocket's handshake is answered with."""
    host = gateway.url.partition("//")[2].partition("/")[0]
    connection = http.client.HTTPConnection(host, timeout=10)
    headers = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",  # of RFC 6455, 1.3
        **({"Origin": origin} if origin else {}),
    }
    connection.request("GET", f"/socket?token={token}", headers=headers)
    try:
        return connection.getresponse().status
    finally:
        connection.close()


def test_only_the_page_that_was_printed_may_connect(shared):
    gateway = shared[1]
    base, _, token = gateway.url.partition("/#")
    assert upgrade(gateway, token, base) == 101
    assert upgrade(gateway, "wrong", base) == 403
    assert upgrade(gateway, "", base) == 403
    assert upgrade(gateway, token, "http://evil.example") == 403
    assert upgrade(gateway, token, None) == 403


def test_another_name_for_this_computer_is_refused(shared):
    base = shared[1].url.partition("/#")[0]
    assert status(base)[0] == 200
    assert status(base, Host="evil.example")[0] == 403  # DNS rebinding


def test_the_page_has_a_policy_and_needs_nothing_from_elsewhere(shared, visit):
    gateway = shared[1]
    base = gateway.url.partition("/#")[0]
    assert status(base)[1]["Content-Security-Policy"].startswith("default-src 'none'")
    page = visit(gateway, ready=False)
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.reload()
    page.locator("#state", has_text="STOPPED").wait_for()
    assert [url for url in asked if not url.startswith((base, base.replace("http", "ws"), "data:"))] == []
    assert page.troubles == []


@pytest.mark.skipif("AXE" not in os.environ, reason="AXE does not name axe.min.js")
@pytest.mark.parametrize("width", [1280, 390])
def test_axe_finds_nothing(shared, visit, accessible, width):
    """Views of other robots have theirs in test_field.py, test_reasons.py, test_recordings.py."""
    page = visit(shared[1])
    page.set_viewport_size({"width": width, "height": 844})
    page.locator("#pad summary").click()
    for _ in range(2):
        page.locator("#go-add").click()
    accessible(page)


def test_a_phone_shows_the_page_without_scrolling_sideways(shared, visit):
    page = visit(shared[1], has_touch=True, is_mobile=True)
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    stop = page.locator("#stop").bounding_box()
    assert stop["y"] + stop["height"] <= 844
    assert stop["width"] > 300


def test_the_keyboard_reaches_everything(shared, visit):
    page = visit(shared[1])
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.dataset.tool || ''"))
    assert {"stop", "theme", "go", "speed", "go-x", "kick", "field", "record", "events-scroll", "motors"} <= reached
    page.locator("[data-tool=points]").focus()
    page.keyboard.press("Enter")
    assert page.locator("[data-tool=points]").get_attribute("aria-pressed") == "true"


def test_way_points_are_sorted_by_the_keyboard(shared, visit):
    page = visit(shared[1])
    for x in (1, 2, 3):
        page.locator("#go-x").fill(str(x))
        page.locator("#go-add").click()
    page.get_by_label("Way-point 3 earlier").focus()
    for _ in range(2):  # the focus goes with the point
        page.wait_for_timeout(250)  # while the panels are drawn anew
        page.keyboard.press("Enter")
    assert [text[:4] for text in page.locator("#points li span").all_inner_texts()] == ["3.00", "1.00", "2.00"]
    page.get_by_label("Remove way-point 1").focus()
    page.keyboard.press("Enter")
    page.keyboard.press("Enter")
    assert [text[:4] for text in page.locator("#points li span").all_inner_texts()] == ["2.00"]


def test_robots_have_names_and_addresses_of_all_kinds(robot, start, visit):
    with Server(ROOT / "examples/sim.cfg", listen="::1") as six:
        named = type("Named", (), {"robot": f"localhost:{robot.port}"})
        nobody = type("Nobody", (), {"robot": "no-such-robot.invalid"})
        page = visit(start(named, six, nobody))
        page.locator(".chip", has_text=f"[::1]:{six.port}").click()
        page.locator("#driver", has_text=f"[::1]:{six.port} · driven by nobody").wait_for()
        page.locator(".chip", has_text="no-such-robot").click()
        page.locator("#state", has_text="NOT CONNECTED").wait_for()
        page.locator("#reason", has_text="no-such-robot.invalid").wait_for()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (":6665", "robot ':6665': that is no host"),
        ("robot7:99999", "the port must be a number from 1 to 65535"),
        ("robot7:66:65", "too many colons"),
        ("[::1", "write an IPv6 address with a port as [::1]:6665"),
        ("http://robot7", "that is no host"),
    ],
)
def test_a_wrong_address_is_refused_in_words(wrong, words):
    done = run("teleop", "--no-browser", wrong)
    assert done.returncode == 2
    assert words in done.stderr and wrong in done.stderr


def test_a_robot_that_is_named_twice_is_refused():
    done = run("teleop", "--no-browser", "robot7", "robot7:6665")
    assert done.returncode == 2 and "'robot7:6665' is named twice" in done.stderr


def test_a_package_without_its_page_says_how_to_get_one(tmp_path):
    assert REGISTA[0] == sys.executable
    program = f"""
import pathlib, regista.teleop
regista.teleop.PAGE = pathlib.Path({str(tmp_path)!r})
from regista.cli import main
main()
"""
    done = subprocess.run(
        [sys.executable, "-c", program, "teleop", "--no-browser"],
        env=environment(),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 1 and "built without its page" in done.stderr and "REGISTA_PAGE" in done.stderr
