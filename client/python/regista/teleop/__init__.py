# SPDX-License-Identifier: Apache-2.0
"""The gateway between a web page and robots: what `regista teleop` runs. Wants the extra `regista[teleop]`."""

from pathlib import Path

# What Vite built from client/teleop; absent in a package that was built without it.
PAGE = Path(__file__).parent / "page"
