# SPDX-License-Identifier: Apache-2.0
"""What the package raises when a robot cannot be talked to, or says no."""

from __future__ import annotations

import builtins


class Error(Exception):
    """`str()` says all: "position2d:0 at robot7:6665: SET_ODOM refused: busy; remedy"."""

    host: str
    port: int
    device: str
    """ "position2d:0", or empty: the server itself."""
    asked: str
    """What was asked: "SET_ODOM", "connect"."""
    reason: str
    """The server's words where it gave any."""

    def __init__(
        self, text: str, host: str = "", port: int = 0, device: str = "", asked: str = "", reason: str = ""
    ) -> None:
        super().__init__(text)
        self.host, self.port, self.device, self.asked, self.reason = host, port, device, asked, reason

    def __reduce__(self) -> tuple[type[Error], tuple[str | int, ...]]:
        return type(self), (str(self), self.host, self.port, self.device, self.asked, self.reason)


class ConnectionError(Error, builtins.ConnectionError):
    """There is no connection, or it broke: `robot.reconnect()`."""


class TimeoutError(Error, builtins.TimeoutError):
    """The server did not answer or fell silent."""


class RefusedError(Error):
    """The server or the device said no."""
