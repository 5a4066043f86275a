# SPDX-License-Identifier: Apache-2.0
"""What the robot did, as its server says, seen by a client that has nothing to do with the page."""

from __future__ import annotations

import threading
import time

import regista
from command_line import wait_for


class Observer:
    """Follows the base on a thread of its own."""

    def __init__(self, server):
        self._robot = regista.Robot("127.0.0.1", server.port, name="observer")
        self._base = self._robot.position2d()
        self._motion = self._base.motion()
        self.samples = []  # (time.monotonic(), state, owner, reason, speed)
        self.track = []  # (x, y) [m]
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        wait_for(lambda: self.samples)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._end.set()
        self._thread.join()
        self._robot.close()

    def _run(self):
        while not self._end.is_set():
            try:
                self._robot.read(timeout=0.05)
                motion, state = self._base.motion(), self._base.state
            except regista.Error:
                return
            speed = abs(state.velocity.x) + abs(state.velocity.y) + abs(state.velocity.w)
            self.pose, self.velocity = state.pose, state.velocity
            self.samples.append((time.monotonic(), motion.state.name, motion.owner, motion.reason, speed))
            self.track.append((state.pose.x, state.pose.y))

    @property
    def state(self):
        return self.samples[-1][1]

    @property
    def owner(self):
        return self.samples[-1][2]

    @property
    def reason(self):
        return self.samples[-1][3]

    def wait(self, look):
        return wait_for(lambda: look(self))

    def wait_driving(self):
        """Until it drives at speed."""
        wait_for(lambda: self.state == "driving" and self.samples[-1][4] > 0.2)

    def stop_times(self, since):
        """[ms] from `since` until the base slowed down, and until it was at rest."""
        speed = [s[4] for s in self.samples if s[0] <= since][-1]
        assert speed > 0.2
        self.wait(lambda s: s.samples[-1][0] > since and s.samples[-1][4] < 0.1)
        after = [(t, v) for t, _, _, _, v in self.samples if t > since]
        slow = next(t for t, v in after if v < 0.8 * speed)
        rest = next(t for t, v in after if v < 0.1)
        return (slow - since) * 1e3, (rest - since) * 1e3
