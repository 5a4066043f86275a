# SPDX-License-Identifier: Apache-2.0
"""regista-reproduce, as a script uses it: two runs of each experiment."""

import json
import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
REPRODUCE = Path(os.environ.get("REGISTA_BIN", ROOT / "build/dev/bin")) / "regista-reproduce"
FIELDS = {"source", "quantity", "unit", "controller", "better", "published", "value", "ci95_low", "ci95_high", "note"}


def reproduce(*arguments):
    return subprocess.run([REPRODUCE, *map(str, arguments)], capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize("arguments", [["--json"], ["--json", "-"], ["--json", "--seed", 1]])
def test_json_instead_of_the_text(arguments):
    done = reproduce("--runs", 2, *arguments)
    assert (done.returncode, done.stderr) == (0, "")
    rows = json.loads(done.stdout)
    assert all(set(row) == FIELDS for row in rows)
    assert {row["controller"] for row in rows} == {"published", "ours"}
    assert {row["better"] for row in rows} == {"lower", "higher"}
    assert all(row["ci95_low"] <= row["value"] <= row["ci95_high"] for row in rows)


def test_json_to_a_file_beside_the_text(tmp_path):
    file = tmp_path / "rows.json"
    done = reproduce("--runs", 2, "--seed", 1, "--json", file)
    assert "H square" in done.stdout
    assert json.loads(file.read_text()) == json.loads(reproduce("--runs", 2, "--seed", 1, "--json").stdout)


@pytest.mark.parametrize(
    "arguments",
    [
        ["--seed", "-1"],
        ["--seed", "99999999999999999999999"],
        ["--seed", "x"],
        ["--runs", "1"],
        ["--runs", "x"],
        ["--now"],
    ],
)
def test_wrong_usage_is_told_at_once(arguments):
    done = reproduce(*arguments)
    assert (done.returncode, done.stdout) == (64, "")
    assert arguments[0] in done.stderr
