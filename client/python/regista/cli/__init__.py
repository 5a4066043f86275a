# SPDX-License-Identifier: Apache-2.0
"""The command `regista`: look at a robot, drive it, record it."""

from .app import app, main

__all__ = ["app", "main"]
