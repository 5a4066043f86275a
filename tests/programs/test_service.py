# SPDX-License-Identifier: Apache-2.0
"""The unit for systemd, checked by systemd itself."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SERVER = Path(os.environ.get("REGISTA_BIN", ROOT / "build/dev/bin")).resolve() / "regista-server"
INSTALLED = "/usr/bin/regista-server"


def verify(folder, unit):
    (folder / "regista-server.service").write_text(unit.replace(INSTALLED, str(SERVER)))
    command = ["systemd-analyze", "verify", "--man=no", "--recursive-errors=no", folder / "regista-server.service"]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
def test_systemd_takes_the_unit(tmp_path):
    unit = (ROOT / "dist/regista-server.service").read_text()
    assert f"ExecStart={INSTALLED} " in unit
    done = verify(tmp_path, unit)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    # That it would have told.
    broken = verify(tmp_path, unit.replace("WatchdogSec=", "WatchDogSec="))
    assert "Unknown key 'WatchDogSec' in section [Service]" in broken.stderr
