# SPDX-License-Identifier: Apache-2.0
"""What the doctor finds in a server's status: the illnesses are made up, their shape is a real server's."""

import copy

import pytest
from regista.cli.doctor import Health, examine, silent_after


@pytest.fixture(scope="module")
def well(sim):
    """The status of a real server, without what the machine's load adds."""
    status = sim.json("status")
    for driver in status["drivers"]:
        driver |= {"beats": 1000, "beats_missed": 0, "faults": 0, "open": True}
        for device in driver["devices"]:
            for group in device["motion"]:
                group |= {"state": "stopped", "owner": "", "reason": "no command yet"}
    return status


def findings(status, health):
    return [(finding.thing, finding.reason) for finding in examine(status) if finding.health is health]


def base(status):
    return next(driver for driver in status["drivers"] if driver["name"] == "simulated_base")


def test_a_healthy_server_has_nothing_but_ok(well):
    assert {finding.health for finding in examine(well)} == {Health.OK}


@pytest.mark.parametrize(
    ("change", "health", "text"),
    [
        ({"hung": True}, Health.ERROR, "hangs"),
        ({"beats_missed": 100}, Health.WARN, "misses 10 % of its beats"),
        ({"faults": 3}, Health.WARN, "failed 3 times"),
        ({"faults": 3, "open": False, "devices": [{"subscribers": 1, "motion": []}]}, Health.ERROR, "does not open"),
    ],
)
def test_an_ill_driver(well, change, health, text):
    status = copy.deepcopy(well)
    base(status).update(change)
    assert any(thing == "driver simulated_base" and text in reason for thing, reason in findings(status, health))


def test_a_fault_is_told_with_its_reason(well):
    status = copy.deepcopy(well)
    base(status)["devices"][0]["motion"][0] |= {"state": "fault", "reason": "open /dev/ttyUSB0: no such file"}
    assert ("driver simulated_base", "fault: open /dev/ttyUSB0: no such file") in findings(status, Health.ERROR)


def test_who_drives_is_told(well):
    status = copy.deepcopy(well)
    base(status)["devices"][0]["motion"][0] |= {"state": "driving", "owner": "nav@laptop"}
    assert ("position2d:0 motion", "driven by nav@laptop") in findings(status, Health.OK)


def test_a_slow_client(well):
    status = copy.deepcopy(well)
    status["clients"][0] |= {"name": "viewer", "pending_bytes": 200_000, "data_dropped": 7}
    reasons = [reason for thing, reason in findings(status, Health.WARN) if thing == "client viewer"]
    assert len(reasons) == 2 and "200000 bytes" in reasons[0] and "7 messages" in reasons[1]


def test_slow_devices_may_be_silent_for_longer():
    assert silent_after(100) == 1
    assert silent_after(1) == 5
    assert silent_after(0) == 1
