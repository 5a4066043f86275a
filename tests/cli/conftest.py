# SPDX-License-Identifier: Apache-2.0
import pytest
from command_line import ROOT, Server


@pytest.fixture(scope="session")
def sim():
    """The simulated robot of the examples."""
    with Server(ROOT / "examples/sim.cfg") as server:
        yield server


@pytest.fixture
def fresh():
    """The same, untouched by other tests."""
    with Server(ROOT / "examples/sim.cfg") as server:
        yield server
