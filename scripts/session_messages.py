# SPDX-License-Identifier: Apache-2.0
"""Print the messages of a recorded Player session in hex, header and body, one a line, as they passed."""

import json
import sys
from pathlib import Path

BANNER = 32
HEADER = 40
SIZE_AT = 36

buffers = {"c2s": bytearray(), "s2c": bytearray()}
greeted = False
for chunk in json.loads(Path(sys.argv[1]).read_text())["chunks"]:
    if "hex" not in chunk:  # a connection opened or closed
        continue
    buffer = buffers[chunk["dir"]]
    buffer += bytes.fromhex(chunk["hex"])
    if not greeted and chunk["dir"] == "s2c" and len(buffer) >= BANNER:
        del buffer[:BANNER]
        greeted = True
    while len(buffer) >= HEADER and len(buffer) >= (end := HEADER + int.from_bytes(buffer[SIZE_AT:HEADER], "big")):
        print(buffer[:end].hex())
        del buffer[:end]
