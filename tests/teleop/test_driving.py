# SPDX-License-Identifier: Apache-2.0
"""A person at the page drives a robot; what it did is read at the server."""

from observer import Observer


def test_keys_drive_and_letting_go_stops(robot, start, visit):
    page = visit(start(robot))
    with Observer(robot) as seen:
        page.keyboard.down("w")
        seen.wait_driving()
        seen.wait(lambda s: s.pose.x > 0.3)
        assert seen.owner.startswith("teleop ")
        assert abs(seen.pose.y) < 0.1
        page.keyboard.up("w")
        seen.wait(lambda s: s.state == "stopped" and s.owner == "")
        page.locator("#driver", has_text="driven by nobody").wait_for()
    assert page.troubles == []
