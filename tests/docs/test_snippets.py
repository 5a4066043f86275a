# SPDX-License-Identifier: Apache-2.0
"""What the pages on drivers show stands, word for word, in files that are compiled. A line `…` leaves something out."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
COMPILED = [
    *sorted((ROOT / "examples/driver").iterdir()),
    ROOT / "device/include/regista/device/driver.hpp",
]


def snippets():
    for page in ("writing-a-driver.md", "testing-a-driver.md"):
        text = (ROOT / "docs" / page).read_text()
        for number, (_, body) in enumerate(re.findall(r"^```(cpp|cmake)\n(.*?)^```$", text, re.M | re.S), 1):
            yield pytest.param(body, id=f"{page}-{number}")


@pytest.mark.parametrize("snippet", list(snippets()))
def test_snippet_is_compiled(snippet):
    pieces = [piece for piece in re.split(r"^…\n", snippet, flags=re.M) if piece.strip()]
    assert pieces

    def holds(text):
        """All pieces, in this order."""
        at = 0
        for piece in pieces:
            found = text.find(piece, at)
            if found < 0:
                return False
            at = found + len(piece)
        return True

    assert any(holds(file.read_text()) for file in COMPILED), "not in examples/driver, and so not compiled:\n" + snippet
