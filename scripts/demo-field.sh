#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# demo-field.sh PREFIX SECONDS: a simulated field robot drives missions and tells how it gets on, for SECONDS or
# "infinity". Fails when one is not driven to its end. Part of ./demo, which builds what it needs.
set -euo pipefail
source scripts/common.sh
prefix=$1 seconds=$2

coproc SERVING { exec "$prefix/bin/regista-server" --log-level info examples/field.cfg; }
server=$SERVING_PID
end() {
  if [[ -n ${mission-} ]] && kill "$mission" 2>/dev/null; then wait "$mission" || true; fi
  kill "$server" ${timer:+"$timer"} 2>/dev/null || true
}
trap end EXIT
trap 'exit 0' INT TERM
read -r -t 20 ready <&"${SERVING[0]}" || die "the server did not start"
say "$ready"
say "A field robot drives a mission on two CAN drives, compass and GPS: examples/11_mission.cpp."

sleep "$seconds" &
timer=$!
arrived=0
while kill -0 "$timer" 2>/dev/null; do
  build/examples/11_mission > >(sed -u 's/^/  /') &
  mission=$!
  wait -n -p ended "$mission" "$timer" "$server" || die "the mission was not driven to its end"
  if [[ $ended == "$server" ]]; then die "the server ended"; fi
  if [[ $ended == "$timer" ]]; then break; fi
  arrived=$((arrived + 1))
  say "mission $arrived driven; next"
done
((arrived > 0)) || die "the robot arrived nowhere in $seconds s: a mission takes some 20 s"
say "$arrived missions driven to their end"
