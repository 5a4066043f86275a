# SPDX-License-Identifier: Apache-2.0
import regista

# How full is the battery? What it does not measure is None.
with regista.Robot("localhost") as robot:
    power = robot.power()
    while power.age is None:
        robot.read(timeout=2)
    if power.voltage_v is not None:
        print(f"{power.voltage_v:.0f} V")
    if power.charge_percent is not None:
        print(f"{power.charge_percent:.0f} %")
    print(f"{2.0:.1f} s old at most: {'yes' if power.age < 2 else 'no'}")
