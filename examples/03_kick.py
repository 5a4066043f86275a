# SPDX-License-Identifier: Apache-2.0
import regista

# Charge the kicker, kick, and see it counted.
with regista.Robot("localhost") as robot:
    kicker = robot.kicker()
    kicker.charge(True)
    while not kicker.state.charged:
        robot.read(timeout=0.1)
    kicks = kicker.state.kick_count
    kicker.kick(5.0)
    while kicker.state.kick_count == kicks:
        robot.read(timeout=0.1)
    print(f"kicked once, {'still charged' if kicker.state.charged else 'charging again'}")
