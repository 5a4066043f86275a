#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# with_server.sh SERVER CONFIG PROGRAM EXPECTED: run a program beside a server of its own; it must print what EXPECTED holds.
set -euo pipefail
server=$1 config=$2 program=$3 expected=$4

coproc SERVING { exec "$server" --log-level warning "$config"; }
trap 'kill "$SERVING_PID" 2>/dev/null || true' EXIT
read -r -t 20 ready <&"${SERVING[0]}" || { echo "the server did not start" >&2; exit 1; }
[[ $ready == *"ready on"* ]] || { echo "the server said: $ready" >&2; exit 1; }
diff <(timeout 60 "$program") "$expected"
