# SPDX-License-Identifier: Apache-2.0
"""The dead man's switch, keys and gamepads: time is made up."""

import itertools
import math

import pytest
from regista.cli.hand import (
    AXES,
    BUTTONS,
    EV_ABS,
    EV_KEY,
    EV_SYN,
    EVENT,
    SYN_DROPPED,
    DeadMan,
    Keys,
    Layout,
    Pad,
    Release,
    Velocity,
)

AHEAD = Velocity(x=0.3)


def sent(switch, begin, end):
    """[(time, what)] of a loop that sleeps until the switch has something to do."""
    now, actions = begin, []
    while now <= end:
        while (action := switch.step(now)) is not None:
            actions.append((round(now, 3), action))
        now = max(now + 1e-4, switch.due()) if switch.due() <= end else end + 1
    return actions


def test_nothing_is_sent_before_something_is_held():
    switch = DeadMan()
    assert switch.step(0.0) is None
    assert switch.due() == math.inf


def test_what_is_held_is_repeated_more_often_than_the_shortest_lease():
    switch = DeadMan()
    switch.hold(AHEAD)
    times = [time for time, _ in sent(switch, 0.0, 1.0)]
    assert max(b - a for a, b in itertools.pairwise(times)) <= 0.0502
    assert len(times) == 20 or len(times) == 21


def test_letting_go_sends_three_zeros_then_gives_back_then_is_silent():
    switch = DeadMan()
    switch.hold(AHEAD)
    assert sent(switch, 0.0, 0.01) == [(0.0, AHEAD)]
    switch.let_go()
    actions = sent(switch, 0.03, 2.0)
    assert [action for _, action in actions] == [Velocity(), Velocity(), Velocity(), Release()]
    assert actions[2][0] - actions[0][0] == pytest.approx(0.04, abs=1e-3)
    assert not switch.active


def test_a_hold_that_is_not_renewed_ends():
    switch = DeadMan()
    switch.hold(AHEAD, until=0.2)
    actions = sent(switch, 0.0, 1.0)
    assert actions[-1][1] == Release()
    assert max(time for time, action in actions if action == AHEAD) < 0.2
    assert min(time for time, action in actions if action == Velocity()) == pytest.approx(0.2, abs=0.021)


def test_never_more_than_fifty_commands_a_second():
    switch = DeadMan()
    times = []
    for step in range(1000):
        now = step * 1e-3
        switch.hold(Velocity(x=step * 1e-3))
        if switch.step(now) is not None:
            times.append(now)
    assert len(times) <= 51
    assert len(times) >= 45


def test_holding_again_while_zeros_are_sent_drives_on():
    switch = DeadMan()
    switch.hold(AHEAD)
    switch.step(0.0)
    switch.let_go()
    assert switch.step(0.03) == Velocity()
    switch.hold(AHEAD)
    assert [action for _, action in sent(switch, 0.06, 0.07)] == [AHEAD]


def test_letting_go_of_nothing_sends_nothing():
    switch = DeadMan()
    switch.let_go()
    assert switch.step(0.0) is None


def test_a_tap_holds_until_the_keyboard_would_repeat_and_a_repeat_for_less():
    keys = Keys(speed=0.5, turn=1.0)
    assert keys.press("w", 10.0) == (Velocity(x=0.5), pytest.approx(10.6))
    assert keys.press("w", 10.5) == (Velocity(x=0.5), pytest.approx(10.7))
    assert keys.press("w", 10.53) == (Velocity(x=0.5), pytest.approx(10.73))
    velocity, until = keys.press("a", 10.6)  # another key is a new tap
    assert velocity == Velocity(w=1.0) and until == pytest.approx(11.2)
    assert keys.press("a", 20.0)[1] == pytest.approx(20.6)  # and so is the same one, much later


def test_signs_of_the_keys():
    keys = Keys(1, 1)
    assert keys.press("w", 0)[0].x > 0 > keys.press("s", 0)[0].x
    assert keys.press("q", 0)[0].y > 0 > keys.press("e", 0)[0].y
    assert keys.press("a", 0)[0].w > 0 > keys.press("d", 0)[0].w
    assert keys.press("z", 0) is None


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("w", ["w"]),
        ("W", ["w"]),
        ("\x1b[A\x1b[D", ["w", "a"]),
        ("\x1bOB", ["s"]),
        ("\x1b[1;5C", []),  # with Ctrl: another key
        ("\x1b[3~x", ["x"]),
        ("\x1b", ["\x1b"]),
    ],
)
def test_names_of_keys(text, names):
    assert Keys.names(text) == names


def event(kind, code, value):
    return EVENT.pack(0, 0, kind, code, value)


def pad(**options):
    ranges = dict.fromkeys(AXES.values(), (0, 255))
    return Pad(Layout(), speed=1.0, turn=2.0, ranges=ranges, **options)


HOLD = event(EV_KEY, BUTTONS["BTN_TL"], 1)
TURBO = event(EV_KEY, BUTTONS["BTN_TR"], 1)


def test_a_stick_moves_nothing_without_the_dead_mans_button():
    gamepad = pad()
    gamepad.feed(event(EV_ABS, AXES["ABS_Y"], 0))
    assert gamepad.velocity() is None
    gamepad.feed(HOLD)
    assert gamepad.velocity().x == pytest.approx(0.5)
    gamepad.feed(TURBO)
    assert gamepad.velocity().x == pytest.approx(1.0)
    gamepad.feed(event(EV_KEY, BUTTONS["BTN_TL"], 0))
    assert gamepad.velocity() is None


def test_signs_of_the_sticks():
    gamepad = pad()
    gamepad.feed(HOLD + event(EV_ABS, AXES["ABS_X"], 0) + event(EV_ABS, AXES["ABS_RX"], 255))
    velocity = gamepad.velocity()
    assert velocity.w > 0 > velocity.y


def test_a_stick_near_its_middle_is_still_and_grows_from_there():
    gamepad = pad()
    gamepad.feed(HOLD)
    gamepad.feed(event(EV_ABS, AXES["ABS_Y"], 120))
    assert gamepad.velocity().x == 0
    speeds = []
    for value in range(127, -1, -1):
        gamepad.feed(event(EV_ABS, AXES["ABS_Y"], value))
        speeds.append(gamepad.velocity().x)
    assert speeds == sorted(speeds)
    assert max(b - a for a, b in itertools.pairwise(speeds)) < 0.03


def test_events_come_in_pieces():
    gamepad = pad()
    for byte in HOLD + event(EV_ABS, AXES["ABS_Y"], 0):
        gamepad.feed(bytes([byte]))
    assert gamepad.velocity().x > 0


def test_after_lost_events_the_button_must_be_pressed_anew():
    gamepad = pad()
    gamepad.feed(HOLD + event(EV_SYN, SYN_DROPPED, 0))
    assert gamepad.velocity() is None


def test_the_stop_button_is_told_once():
    gamepad = pad()
    gamepad.feed(event(EV_KEY, BUTTONS["BTN_EAST"], 1))
    assert gamepad.stop_pressed
