# SPDX-License-Identifier: Apache-2.0
import regista

# A device that only its driver and this program understand: the lamps of driver/lamps.cpp, one byte each.
with regista.Robot("localhost") as robot:
    lamps = robot.opaque()
    print(f"there are {lamps.request_bytes(b'')[0]} lamps")
    lamps.send_bytes(bytes([255, 128, 0]))
    while lamps.bytes != bytes([255, 128, 0]):
        robot.read(timeout=0.1)
    print("".join(f"{brightness:3} " for brightness in lamps.bytes))
