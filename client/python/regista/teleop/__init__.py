# SPDX-License-Identifier: Apache-2.0
"""The gateway between a web page and robots: what `regista teleop` runs. Wants the extra `regista[teleop]`."""

from pathlib import Path

PAGE = (
    Path(__file__).parent / "page"
)  # what Vite built from client/teleop; absent in a wheel that was built without npm
