# SPDX-License-Identifier: Apache-2.0
"""The pages that are made from the command's own texts, and the quick start, run."""

import os
import re
import shutil
import socket
import subprocess
import sys

import pytest
from command_line import BIN, REGISTA, ROOT, environment
from regista.cli import manual

PAGE = (ROOT / "docs/quick-start.md").read_text()
NUMBER = re.compile(r"-?\d+(\.\d+)?")


def blocks(text):
    """[(language, body)]"""
    return re.findall(r"^```(\w+)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def essence(line):
    """Without numbers, and whatever the width of columns."""
    return " ".join(NUMBER.sub("#", line).split())


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return listener.getsockname()[1]


def test_the_quick_start_does_what_it_says(tmp_path):
    shutil.copytree(ROOT / "examples", tmp_path / "examples", ignore=shutil.ignore_patterns("driver"))
    (tmp_path / "regista").write_text(f'#!/bin/sh\nexec {" ".join(REGISTA)} "$@"\n')
    (tmp_path / "regista").chmod(0o755)
    port, other = free_port(), free_port()
    # Elsewhere than a robot that somebody may have running on this machine.
    replaced = {
        "regista-server examples/sim.cfg": f"regista-server --port {port} --log-level off examples/sim.cfg",
        'Robot("localhost")': f'Robot("localhost", {port})',
        "--port 7000": f"--port {other}",
    }
    script, expected = ["trap 'kill $(jobs -p)' EXIT", "set -e -o pipefail"], []
    ran = False
    for language, body in blocks(PAGE):
        for here, there in replaced.items():
            body = body.replace(here, there)
        if language == "sh":
            ready = "until regista list >/dev/null 2>&1; do sleep 0.1; done\n" if body.endswith("&\n") else ""
            script.append(body + ready)
        elif language == "python":
            script.append(f"{sys.executable} - <<'END'\n{body}END\n")
        elif ran:
            expected += body.splitlines()
        ran = language in ("sh", "python")
    for here in replaced:
        assert here in PAGE
    env = environment(PATH=f"{tmp_path}:{BIN}:{os.environ['PATH']}", REGISTA_ROBOT=f"localhost:{port}")
    done = subprocess.run(
        ["bash", "-c", "\n".join(script)],
        cwd=tmp_path,
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=180,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    printed = {essence(line) for line in done.stdout.splitlines()}
    missing = [line for line in expected if essence(line) not in printed]
    assert not missing, done.stdout


def test_the_page_of_the_command_line_is_what_help_says():
    page = ROOT / "docs/command-line.md"
    assert page.read_text() == manual.markdown(), f"write it anew: python -m regista.cli.manual markdown > {page}"


def test_man_pages(tmp_path):
    assert manual.main(["man", str(tmp_path)]) == 0
    names = {path.name for path in tmp_path.iterdir()}
    assert {"regista.1", "regista-list.1", "regista-drive.1", "regista-wire-decode.1"} <= names
    for path in tmp_path.iterdir():
        text = path.read_text()
        assert text.startswith(".TH REGISTA")
        assert "\n.SH EXAMPLES\n" in text or path.name in ("regista-mission.1", "regista-wire.1")
    if shutil.which("groff"):
        done = subprocess.run(
            ["groff", "-man", "-Tutf8", "-ww", *map(str, sorted(tmp_path.iterdir()))],
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stderr == ""


def test_the_site_builds(tmp_path):
    pytest.importorskip("mkdocs")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT,
        env=environment(NO_MKDOCS_2_WARNING="1"),
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    api = (tmp_path / "site/api/python/index.html").read_text()
    assert "set_velocity" in api and "regista.Robot" in api
    headers = re.sub("<[^>]*>", "", (tmp_path / "site/api/cpp/index.html").read_text())
    assert "class Robot {" in headers and "void set_velocity(" in headers
