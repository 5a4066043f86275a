# SPDX-License-Identifier: Apache-2.0
"""What a person's hand means for the robot: pure, time [s] is handed in. Used by `regista drive` and `regista joy`.

Nothing moves unless something is held. Letting go sends zero three times, gives the robot back, and then keeps silent.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import ClassVar


@dataclass(frozen=True)
class Velocity:
    """Of the body: x ahead, y to the left [m/s], w counter-clockwise [rad/s]."""

    x: float = 0.0
    y: float = 0.0
    w: float = 0.0


@dataclass(frozen=True)
class Release:
    """Give the robot back: others may drive."""


class DeadMan:
    """Turns holding and letting go into what is to be sent, and when."""

    REPEAT = 0.05  # half of the shortest lease of a server
    SPACING = 0.02  # never more than 50 commands a second
    ZEROS = 3  # one may get lost

    def __init__(self) -> None:
        self._velocity: Velocity | None = None  # None: not held
        self._until = math.inf
        self._sent = -math.inf
        self._next = -math.inf
        self._zeros = 0
        self._releases = False

    def hold(self, velocity: Velocity, until: float = math.inf) -> None:
        """The hand holds this velocity, until it lets go or `until` is reached without another hold."""
        if velocity != self._velocity:
            self._next = -math.inf
        self._velocity, self._until = velocity, until
        self._zeros, self._releases = 0, False

    def let_go(self) -> None:
        """Does nothing when nothing is held."""
        if self._velocity is None:
            return
        self._velocity = None
        self._zeros, self._releases = self.ZEROS, True
        self._next = -math.inf

    @property
    def held(self) -> bool:
        return self._velocity is not None

    @property
    def active(self) -> bool:
        """Something is still to be sent."""
        return self.held or self._releases

    def step(self, now: float) -> Velocity | Release | None:
        """What to send now. Call it again until it returns None, then at `due()`."""
        if self.held and now >= self._until:
            self.let_go()
        if now < max(self._next, self._sent + self.SPACING) or not self.active:
            return None
        if self._velocity is None and self._zeros == 0:
            self._releases = False
            return Release()
        self._sent = now
        if self._velocity is not None:
            self._next = now + self.REPEAT
            return self._velocity
        self._zeros -= 1
        self._next = now + self.SPACING
        return Velocity()

    def due(self) -> float:
        """When `step()` has something to do; infinity: not before the hand moves."""
        if not self.active:
            return math.inf
        return min(max(self._next, self._sent + self.SPACING), self._until if self.held else math.inf)


class Keys:
    """Keys of a terminal, which tells presses and repeats but not when a key is let go.

    A press holds until the keyboard's repeat should have begun; each repeat holds for a shorter time. So a tap moves
    the robot for 0.6 s, and a key that was held stops it 0.2 s after it was let go.
    """

    FIRST = 0.6  # s; keyboards begin to repeat after 0.25 to 0.6 s
    REPEAT = 0.2  # s; and go on at 10 to 30 a second

    DIRECTIONS: ClassVar = {
        "w": (1, 0, 0),
        "s": (-1, 0, 0),
        "a": (0, 0, 1),
        "d": (0, 0, -1),
        "q": (0, 1, 0),
        "e": (0, -1, 0),
    }
    _ARROWS: ClassVar = {"A": "w", "B": "s", "C": "d", "D": "a"}  # ECMA-48 cursor keys: up, down, right, left

    def __init__(self, speed: float, turn: float) -> None:
        self.speed, self.turn = speed, turn  # m/s, rad/s
        self._last = ""
        self._last_at = -math.inf

    @classmethod
    def names(cls, text: str) -> list[str]:
        """The keys in what a terminal sent; an arrow key is its letter. Other sequences are left out."""
        keys: list[str] = []
        i = 0
        while i < len(text):
            if text[i] == "\x1b" and text[i + 1 : i + 2] in ("[", "O"):
                end = i + 2
                while end < len(text) and not text[end].isalpha() and text[end] != "~":
                    end += 1
                if text[end : end + 1] in cls._ARROWS and end == i + 2:
                    keys.append(cls._ARROWS[text[end]])
                i = end + 1
            else:
                keys.append(text[i].lower())
                i += 1
        return keys

    def press(self, key: str, now: float) -> tuple[Velocity, float] | None:
        """The velocity that the key means, and until when it holds. None: it is no direction."""
        direction = self.DIRECTIONS.get(key)
        if direction is None:
            return None
        repeats = key == self._last and now - self._last_at <= self.FIRST
        self._last, self._last_at = key, now
        x, y, w = direction
        return Velocity(x * self.speed, y * self.speed, w * self.turn), now + (self.REPEAT if repeats else self.FIRST)

    def scale(self, factor: float) -> None:
        self.speed *= factor
        self.turn *= factor


# linux/input.h: struct input_event; types; codes of the gamepad that the kernel documents (gamepad.rst)
EVENT = struct.Struct("@llHHi")
EV_SYN, EV_KEY, EV_ABS = 0, 1, 3
SYN_DROPPED = 3
AXES = {"ABS_X": 0, "ABS_Y": 1, "ABS_Z": 2, "ABS_RX": 3, "ABS_RY": 4, "ABS_RZ": 5, "ABS_HAT0X": 16, "ABS_HAT0Y": 17}
BUTTONS = {
    "BTN_SOUTH": 0x130, "BTN_EAST": 0x131, "BTN_NORTH": 0x133, "BTN_WEST": 0x134, "BTN_TL": 0x136, "BTN_TR": 0x137,
    "BTN_TL2": 0x138, "BTN_TR2": 0x139, "BTN_SELECT": 0x13A, "BTN_START": 0x13B,
    "BTN_TRIGGER": 0x120, "BTN_THUMB": 0x121, "BTN_TOP": 0x123,
}  # fmt: skip


@dataclass(frozen=True)
class Layout:
    """Which part of a gamepad does what: codes of AXES and BUTTONS."""

    ahead: int = AXES["ABS_Y"]
    turn: int = AXES["ABS_X"]
    side: int = AXES["ABS_RX"]
    hold: int = BUTTONS["BTN_TL"]
    turbo: int = BUTTONS["BTN_TR"]
    stop: int = BUTTONS["BTN_EAST"]


class Pad:
    """A gamepad, fed with the bytes of its event device."""

    DEAD_ZONE = 0.1  # of a stick that nobody touches
    EXPO = 0.6  # share of the cubic part: fine near the middle, everything at the rim
    SLOW = 0.5  # without turbo

    def __init__(self, layout: Layout, speed: float, turn: float, ranges: dict[int, tuple[int, int]]) -> None:
        """`ranges`: smallest and largest value of each axis."""
        self._layout, self._speed, self._turn = layout, speed, turn
        self._ranges = ranges
        self._axes: dict[int, float] = {}
        self._buttons: set[int] = set()
        self._rest = b""
        self.stop_pressed = False  # the caller clears it

    def feed(self, data: bytes) -> None:
        data = self._rest + data
        whole = len(data) - len(data) % EVENT.size
        self._rest = data[whole:]
        for _, _, kind, code, value in EVENT.iter_unpack(data[:whole]):
            if kind == EV_KEY:
                self._button(code, value)
            elif kind == EV_ABS:
                low, high = self._ranges.get(code, (-32768, 32767))
                self._axes[code] = max(-1.0, min(1.0, 2 * (value - low) / (high - low) - 1))
            elif kind == EV_SYN and code == SYN_DROPPED:
                self._buttons.clear()  # we missed some: nothing counts as held until it is pressed again

    def _button(self, code: int, value: int) -> None:
        if value == 0:
            self._buttons.discard(code)
        elif value == 1:
            self._buttons.add(code)
            self.stop_pressed |= code == self._layout.stop

    def velocity(self) -> Velocity | None:
        """None: the dead man's button is not held."""
        layout = self._layout
        if layout.hold not in self._buttons:
            return None
        scale = 1.0 if layout.turbo in self._buttons else self.SLOW
        # The kernel's axes point right and down (gamepad.rst); ours ahead, left and counter-clockwise.
        return Velocity(
            x=-self._stick(layout.ahead) * self._speed * scale,
            y=-self._stick(layout.side) * self._speed * scale,
            w=-self._stick(layout.turn) * self._turn * scale,
        )

    def _stick(self, axis: int) -> float:
        value = self._axes.get(axis, 0.0)
        beyond = max(0.0, abs(value) - self.DEAD_ZONE) / (1 - self.DEAD_ZONE)
        return math.copysign((1 - self.EXPO) * beyond + self.EXPO * beyond**3, value)
