# SPDX-License-Identifier: Apache-2.0
"""Print the cases of a JUnit file, one a line: "pass NAME", "fail NAME" or "skip NAME: REASON"."""

import sys
from xml.etree import ElementTree

for case in ElementTree.parse(sys.argv[1]).iter("testcase"):
    # CTest writes the name twice; pytest writes file and function.
    name = ".".join(dict.fromkeys(filter(None, (case.get("classname"), case.get("name")))))
    if case.find("failure") is not None or case.find("error") is not None:
        print("fail", name)
    elif (skipped := case.find("skipped")) is not None:
        print(f"skip {name}:", " ".join(skipped.get("message", "").split()))
    else:
        print("pass", name)
