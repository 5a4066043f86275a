# SPDX-License-Identifier: Apache-2.0
"""Print the cases of a JUnit file, one a line: "pass NAME" or "fail NAME". Skipped cases are neither."""

import sys
from xml.etree import ElementTree

for case in ElementTree.parse(sys.argv[1]).iter("testcase"):
    # CTest writes the name twice; pytest writes file and function.
    name = ".".join(dict.fromkeys(filter(None, (case.get("classname"), case.get("name")))))
    if case.find("failure") is not None or case.find("error") is not None:
        print("fail", name)
    elif case.find("skipped") is None:
        print("pass", name)
