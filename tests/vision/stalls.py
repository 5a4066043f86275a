# SPDX-License-Identifier: Apache-2.0
"""How long a byte takes from one end of a pseudo-terminal to the other at worst [s], until standard input ends. A
process of its own, in which nothing else holds the interpreter."""

import os
import select
import sys
import time
import tty

near, far = os.openpty()
tty.setraw(far)
print("measuring", flush=True)
worst = 0.0
while not select.select([sys.stdin], [], [], 0.005)[0]:
    sent = time.monotonic()
    os.write(near, b"x")
    os.read(far, 1)
    worst = max(worst, time.monotonic() - sent)
print(worst)
