#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# field.sh [OPTION...] [-- COMMAND...]
#
# A simulated field: regista-field-sim with its cameras, a regista-server for each robot, and regista-vision-bridge, all
# on this computer only. Runs COMMAND in a folder with the configuration of it all, team.cfg, and returns its status;
# without one, waits for Ctrl-C.
#
#   --yellow N, --blue N   robots of a team (6)
#   --port N               TCP: yellow robots at N and on, blue ones at N + 16, the bridge's status at N + 32 (6700)
#   --udp N                UDP: vision at N, tracked vision at N + 1, referee at N + 2 (the league's: 10020, 10010, 10003)
#   --sim OPTION...        for regista-field-sim, one word: "--used --cameras 4"
#   --simulator PROTOCOL   none of that, but a simulator of the league that runs here already: "league", or "grsim" for
#                          grSim's own packets. Its robots are driven, and its vision is heard
#   --interface NAME       where that vision comes (all that can multicast, but not lo)
#
# Programs are looked for in $REGISTA_BIN, or else in the PATH.
set -euo pipefail

yellow=6 blue=6 port=6700 vision=10020 tracked=10010 referee=10003 sim=() simulator='' interface=''
while (($#)); do
  case $1 in
    --yellow) yellow=$2 && shift ;;
    --blue) blue=$2 && shift ;;
    --port) port=$2 && shift ;;
    --udp) vision=$2 tracked=$(($2 + 1)) referee=$(($2 + 2)) && shift ;;
    --sim) read -r -a sim <<<"$2" && shift ;;
    --simulator) simulator=$2 && shift ;;
    --interface) interface=$2 && shift ;;
    --) shift && break ;;
    *) echo "field.sh: no option '$1'" >&2 && exit 64 ;;
  esac
  shift
done
command=("$@")
# It runs in another folder. Links stay links: the python of a venv is one.
for i in "${!command[@]}"; do
  [[ ${command[i]} != */* || ! -e ${command[i]} ]] || command[i]=$(realpath -s -- "${command[i]}")
done
bin=${REGISTA_BIN:+$(cd "$REGISTA_BIN" && pwd)/}
folder=$(mktemp -d)
pids=()
end() {
  trap - EXIT
  # The servers last: they and the bridge have something to say to each other.
  ((${#pids[@]} == 0)) || kill "${pids[@]}" 2>/dev/null || true
  wait
  rm -rf "$folder"
}
trap end EXIT
trap 'exit 130' INT TERM

# start NAME COMMAND...: what it says stands in NAME.log.
start() {
  local name=$1
  shift
  : >"$folder/$name.out"
  "$@" >"$folder/$name.out" 2>"$folder/$name.log" &
  pids+=($!)
}
# The line with which NAME says that it is ready.
await() {
  local tries=0
  until grep -q ready "$folder/$1.out"; do
    sleep 0.05
    if ((++tries > 400)) || ! kill -0 "${pids[-1]}" 2>/dev/null; then
      cat "$folder/$1.log" >&2
      echo "field.sh: $1 did not start" >&2
      exit 1
    fi
  done
}

delay=0.02 # the simulated cameras' timestamps hide it
if [[ $simulator ]]; then
  delay=0 # grSim's hide nothing
else
  interface=lo
  start field "${bin}regista-field-sim" "$folder/boards" --yellow "$yellow" --blue "$blue" --port "$vision" "${sim[@]}"
  await field
fi
{
  echo "vision ( port $vision tracked_port $tracked referee_port $referee"
  [[ -z $interface ]] || echo "  interfaces [\"$interface\"]"
  echo "  publish [\"lo\"] delay $delay status_port $((port + 32))"
  echo ")"
} >"$folder/team.cfg"
add_team() {
  local team=$1 count=$2 first=$3 i
  for ((i = 0; i < count; ++i)); do
    local robot="name \"ssl_robot\" port \"$folder/boards/$team$i\" provides [\"position2d:0\" \"position2d:1\" \"kicker:0\" \"power:0\"]"
    [[ -z $simulator ]] ||
      robot="name \"ssl_simulator\" protocol \"$simulator\" team \"$team\" robot $i provides [\"position2d:0\" \"position2d:1\" \"kicker:0\"]"
    cat >"$folder/$team$i.cfg" <<END
driver
(
  $robot
  rate 100
  vision_sd 0.008  # of poses that the bridge has filtered: their errors last
  speed 1.2
  accel 2
  turn_speed 230
  turn_accel 800
  max_speed 2
  max_acceleration 4
  max_turn 10
  max_turn_acceleration 40
  ramp 4
  turn_ramp 40
)
END
    start "$team$i" "${bin}regista-server" --listen 127.0.0.1 --port $((first + i)) "$folder/$team$i.cfg"
    printf 'robot (\n  team "%s" id %d host "127.0.0.1" port %d\n)\n' "$team" "$i" $((first + i)) >>"$folder/team.cfg"
  done
}
add_team yellow "$yellow" "$port"
add_team blue "$blue" $((port + 16))
for ((i = 0; i < yellow; ++i)); do await "yellow$i"; done
for ((i = 0; i < blue; ++i)); do await "blue$i"; done
start bridge "${bin}regista-vision-bridge" "$folder/team.cfg"
await bridge
echo "yellow at 127.0.0.1:$port and on, blue at $((port + 16)) and on; the bridge says how it goes at :$((port + 32))" >&2

cd "$folder"
if ((${#command[@]})); then
  "${command[@]}" <&0 &
  pids+=($!)
  wait $!
else
  wait
fi
