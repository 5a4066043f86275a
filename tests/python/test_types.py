# SPDX-License-Identifier: Apache-2.0
"""What editors and mypy are told is true."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    "command",
    [
        ["mypy", "--strict", "-p", "regista"],
        ["mypy", "--strict", *sorted((ROOT / "examples").glob("*.py"))],
        ["mypy.stubtest", "--allowlist", Path(__file__).with_name("stubtest.txt"), "regista._core", "regista._soccer"],
    ],
    ids=["package", "examples", "stubs"],
)
def test_mypy_agrees(command, tmp_path):
    # Away from the tree, so that the installed package is looked at.
    result = subprocess.run([sys.executable, "-m", *command], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
