#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# with_server.sh SERVER PLUGINS CONFIG PROGRAM EXPECTED: run a program beside a server of its own, which finds more drivers in
# the folder PLUGINS; the program must print what EXPECTED holds.
set -euo pipefail
server=$1 plugins=$2 config=$3 program=$4 expected=$5

coproc SERVING { exec "$server" --log-level warning --plugins "$plugins" "$config"; }
trap 'kill "$SERVING_PID" 2>/dev/null || true' EXIT
read -r -t 20 ready <&"${SERVING[0]}" || { echo "the server did not start" >&2; exit 1; }
[[ $ready == *"ready on"* ]] || { echo "the server said: $ready" >&2; exit 1; }
diff <(timeout 60 "$program") "$expected"
