# SPDX-License-Identifier: Apache-2.0
"""Tries to include what a floor may not include, and fails when that compiles.

walls.py floor NAME COMPILER DIRECTORY...   with exactly the include directories that CMake gives to NAME
walls.py libraries                          third-party headers appear only in the folders that are their home

The tables below say the rule once more, apart from CMakeLists.txt, so that a wrong line there is found here.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]

MAY_INCLUDE = {
    "core": [],
    "metrics": [],
    "interfaces": ["core"],
    "xdr": ["interfaces", "core"],
    "device": ["interfaces", "core"],
    "control": ["core"],
    "canopen": ["core"],
    "ssl": ["core"],
    "motor_board": ["core"],
    "sim": ["motor_board", "canopen", "core"],
    "client/cpp": ["xdr", "interfaces", "core"],
    "server": ["device", "xdr", "interfaces", "core", "client/cpp", "metrics"],
    "testing": ["server", "client/cpp", "device", "xdr", "interfaces", "core", "metrics"],
    "vision_bridge": ["ssl", "control", "device", "interfaces", "core"],
    "camera": ["ssl", "core"],
    "soccer": ["vision_bridge", "client/cpp", "xdr", "ssl", "control", "device", "interfaces", "core"],
}

# Header prefix: the folders that may name it. No public header of core, interfaces or device is among them.
HOMES = {
    "Eigen/": ["control", "sim", "drivers"],
    "asio": ["server", "client/cpp", "ssl", "vision_bridge", "testing", "drivers", "programs"],
    "linux/can": ["canopen/src"],
    "google/protobuf": ["ssl"],
    "opencv2/": ["camera"],
    "gps.h": ["drivers"],
    "GeographicLib/": ["drivers"],
    "spdlog/": ["server", "programs", "vision_bridge", "camera"],
    "fmt/": ["server", "programs", "vision_bridge", "camera"],
    "CLI/": ["server", "programs", "vision_bridge", "camera"],
    "nlohmann/": ["metrics/src", "server", "programs", "vision_bridge", "camera"],
    "pybind11/": ["client/python"],
}
STD_ONLY = ["core/include", "interfaces/include", "device/include"]


def headers(floor: str) -> list[str]:
    folder = ROOT / floor / "include"
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.hpp"))


def compile_includes(compiler: str, directories: list[str], names: list[str]) -> subprocess.CompletedProcess:
    unit = "".join(f"#include <{name}>\n" for name in names)
    flags = ["-std=c++20", "-fsyntax-only", "-x", "c++", "-", *(f"-I{directory}" for directory in directories)]
    english = {**os.environ, "LC_ALL": "C"}
    return subprocess.run([compiler, *flags], input=unit, capture_output=True, text=True, check=False, env=english)


def check_floor(floor: str, compiler: str, directories: list[str]) -> list[str]:
    if floor not in MAY_INCLUDE:
        return [f"'{floor}' is missing in MAY_INCLUDE of {Path(__file__).name}"]
    allowed = [floor, *MAY_INCLUDE[floor]]
    errors = []
    permitted = compile_includes(compiler, directories, [name for other in allowed for name in headers(other)[:1]])
    if permitted.returncode != 0:
        errors.append(f"{floor} may include {', '.join(allowed)}, but this does not compile:\n{permitted.stderr}")
    for other in MAY_INCLUDE.keys() - set(allowed):
        for name in headers(other)[:1]:
            forbidden = compile_includes(compiler, directories, [name])
            if forbidden.returncode == 0:
                errors.append(f"{floor} may not include {other}, but <{name}> compiles")
            elif not re.search(rf"fatal error: '?{re.escape(name)}", forbidden.stderr):
                errors.append(f"{floor} finds <{name}> of {other}, which fails only later:\n{forbidden.stderr}")
            else:
                print(f"<{name}> is not to be found")
    return errors


def check_libraries() -> list[str]:
    errors = []
    floors = [*MAY_INCLUDE, "drivers", "programs", "client/python"]
    sources = sorted({path for floor in floors for path in (ROOT / floor).rglob("*.[ch]pp")})
    for path in sources:
        place = path.relative_to(ROOT).as_posix()
        for name in re.findall(r"^\s*#\s*include\s*<([^>]+)>", path.read_text(), re.MULTILINE):
            for prefix, homes in HOMES.items():
                if name.startswith(prefix) and not any(place.startswith(f"{home}/") for home in homes):
                    errors.append(f"{place} includes <{name}>, which is at home in {', '.join(homes)}")
            # The headers of the standard library, and only these, have neither folder nor suffix.
            is_public = any(place.startswith(f"{folder}/") for folder in STD_ONLY)
            if is_public and not name.startswith("regista/") and not re.fullmatch(r"[a-z_]+", name):
                errors.append(f"{place} is a public header and includes <{name}>: only the standard library there")
    print(f"{len(sources)} files read")
    return errors if sources else ["no source found"]


def main() -> int:
    match sys.argv[1:]:
        case ["floor", floor, compiler, *directories]:
            errors = check_floor(floor, compiler, directories)
        case ["libraries"]:
            errors = check_libraries()
        case _:
            errors = [__doc__]
    for error in errors:
        print(error, file=sys.stderr)
    return 1 if errors else 0


if __name__ == "__main__":
    sys.exit(main())
