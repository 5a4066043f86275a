# SPDX-License-Identifier: Apache-2.0
"""The verb mission: lists of points for a planner."""

from __future__ import annotations

import json as json_text
import sys
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

import regista
from regista import Pose2d, planner

from . import common
from .common import JsonOption, RobotOption, TimeoutOption, examples
from .look import LOCALHOST

PlannerOption = Annotated[str, typer.Option("--device", "-d", help="Which planner.")]
POLL_SECONDS = 0.1
FORM = """\
The file is JSON; headings [rad] and work at a point may be left out:
  {"id": "north field",
   "points": [{"x": 3, "y": 0},
              {"x": 5, "y": 2, "heading": 1.57, "do": [{"relay": 0, "on": true}, {"wait": 2}, {"ask": true}]}]}"""


def _wrong(file: Path, what: str) -> NoReturn:
    common.fail(common.USAGE, f"{file}: {what}; `regista mission upload --help` shows the form")


def _number(file: Path, where: str, place: dict[str, Any], key: str, default: float | None = None) -> float:
    value = place.get(key, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        _wrong(file, f"{where} has no number {key!r}")
    return float(value)


def _action(file: Path, point: int, number: int, what: Any) -> planner.Action:
    where = f"point {point}, work {number}"
    match what:
        case {"wait": int() | float() as seconds, **rest} if not rest and not isinstance(seconds, bool):
            return planner.Action(point=point, act=planner.Act.wait, duration_s=float(seconds))
        case {"relay": int() as output, "on": bool() as on, **rest} if not rest and output >= 0:
            return planner.Action(point=point, act=planner.Act.relay, output=output, on=int(on))
        case {"ask": True, **rest} if not rest:
            return planner.Action(point=point, act=planner.Act.ask)
    _wrong(file, f'{where} is none of {{"wait": SECONDS}}, {{"relay": OUTPUT, "on": true}}, {{"ask": true}}')


def read_mission(file: Path) -> planner.SetMission:
    """Ends the program with what is wrong, and where."""
    try:
        told = json_text.loads(file.read_text() if str(file) != "-" else sys.stdin.read())
    except ValueError as error:
        _wrong(file, f"no JSON: {error}")
    if not isinstance(told, dict) or not isinstance(told.get("points"), list) or not told["points"]:
        _wrong(file, 'no list "points"')
    points, actions = [], []
    for number, point in enumerate(told["points"]):
        where = f"point {number}"
        if not isinstance(point, dict):
            _wrong(file, f"{where} is no object")
        if unknown := set(point) - {"x", "y", "heading", "do"}:
            _wrong(file, f"{where} has {min(unknown)!r}")
        points.append(Pose2d(*(_number(file, where, point, key, default) for key, default in _KEYS)))
        work = point.get("do", [])
        if not isinstance(work, list):
            _wrong(file, f'"do" of {where} is no list')
        actions += [_action(file, number, i, what) for i, what in enumerate(work)]
    return planner.SetMission(id=str(told.get("id", file.stem)), points=points, actions=actions)


_KEYS = (("x", None), ("y", None), ("heading", 0.0))


def _told(mission: planner.Mission) -> dict[str, Any]:
    return {
        "id": mission.id,
        "state": common.state_name(mission.state),
        "point": mission.point,
        "count": mission.count,
        "action": mission.action,
        "distance_m": round(mission.distance_m, 3),
        "reason": mission.reason,
    }


def _line(mission: planner.Mission) -> str:
    state = common.state_name(mission.state)
    if state == "none":
        return "no mission"
    line = f'mission "{mission.id}" {state}'
    if state == "finished":
        return line
    line += f": point {mission.point} of {mission.count}"
    if state == "driving":
        line += f", {mission.distance_m:.1f} m to go"
    if state in ("working", "asking"):
        line += f", action {mission.action}"
    return line + (f"; {mission.reason}" if mission.reason else "")


def _show(mission: planner.Mission, json: bool) -> None:
    if json:
        common.print_json(_told(mission))
    else:
        common.console.print(_line(mission), markup=False)


def upload(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The mission; -: standard input.")],
    device: PlannerOption = "planner:0",
    robot: RobotOption = LOCALHOST,
    timeout: TimeoutOption = 2.0,
) -> None:
    """Hand over a list of points, and what is to be done there. Moves nothing."""
    mission = read_mission(file)
    with common.connect(robot, "mission", timeout=timeout, priority=common.PEOPLE) as connection:
        connection.device(common.parse_device(device)).request(mission)
    common.note(f'mission "{mission.id}": {len(mission.points)} points, {len(mission.actions)} actions')


def show(
    device: PlannerOption = "planner:0",
    robot: RobotOption = LOCALHOST,
    json: JsonOption = False,
    timeout: TimeoutOption = 2.0,
) -> None:
    """How far the mission is, and why it stands."""
    with common.connect(robot, "mission", timeout=timeout) as connection:
        _show(connection.device(common.parse_device(device)).request(planner.GetMission()), json)


def start(
    device: PlannerOption = "planner:0",
    robot: RobotOption = LOCALHOST,
    power: Annotated[
        str | None, typer.Option("--power", metavar="DEVICE", help="Ask this position2d for MOTOR_POWER 1 first.")
    ] = None,
    json: JsonOption = False,
    timeout: TimeoutOption = 5.0,
) -> None:
    """Drive the uploaded mission, or go on where it was stopped, and tell how it gets on.

    Until it is finished or fails, or Ctrl-C: the robot stops when this program ends."""
    with common.connect(robot, "mission", timeout=timeout, priority=common.PEOPLE) as connection:
        driver = connection.device(common.parse_device(device))
        mission = driver.request(planner.GetMission())
        if common.state_name(mission.state) == "none":
            common.fail(common.REFUSED, f"{driver.address} has no mission; `regista mission upload FILE`")
        if power is not None:
            connection.position2d(common.index_of(common.parse_device(power), "position2d")).set_motor_power(True)
        driver.send(planner.RunCommand(id=mission.id))
        driver.keep_alive(True)
        _follow(connection, driver, json)


def _follow(connection: regista.Robot, driver: Any, json: bool) -> None:
    shown = None
    while True:
        for event in connection.events():
            if event.text.startswith(f"{driver.address} refused"):
                common.fail(common.REFUSED, event.text)
        mission = driver.request(planner.GetMission())
        state = common.state_name(mission.state)
        now = (state, mission.point, mission.action, mission.reason)
        if now != shown and state != "ready":
            _show(mission, json)
            shown = now
        if state == "finished":
            return
        if state == "failed":
            common.fail(common.FAILED, f"the mission failed: {mission.reason}; `regista mission resume` tries again")
        common.wait(connection, POLL_SECONDS)


def _ask(device: str, robot: str, timeout: float, request: Any) -> None:
    with common.connect(robot, "mission", timeout=timeout, priority=common.PEOPLE) as connection:
        connection.device(common.parse_device(device)).request(request)


def pause(device: PlannerOption = "planner:0", robot: RobotOption = LOCALHOST, timeout: TimeoutOption = 2.0) -> None:
    """Stand still; whoever started it stays its owner."""
    _ask(device, robot, timeout, planner.Enable(on=0))


def resume(device: PlannerOption = "planner:0", robot: RobotOption = LOCALHOST, timeout: TimeoutOption = 2.0) -> None:
    """Go on after a pause, or try again what failed, while whoever started it is there."""
    _ask(device, robot, timeout, planner.Enable(on=1))


def go_on(device: PlannerOption = "planner:0", robot: RobotOption = LOCALHOST, timeout: TimeoutOption = 2.0) -> None:
    """Answer a point that asks."""
    with common.connect(robot, "mission", timeout=timeout, priority=common.PEOPLE) as connection:
        driver = connection.device(common.parse_device(device))
        mission = driver.request(planner.GetMission())
        driver.request(planner.GoOn(point=mission.point, action=mission.action))


def cancel(device: PlannerOption = "planner:0", robot: RobotOption = LOCALHOST, timeout: TimeoutOption = 2.0) -> None:
    """Stop it and take it from whoever drives it; `start` goes on with it."""
    with common.connect(robot, "mission", timeout=timeout, priority=common.PEOPLE) as connection:
        driver = connection.device(common.parse_device(device))
        driver.take("mission")
        driver.release("mission")


def add_to(app: typer.Typer) -> None:
    verbs = typer.Typer(
        help="Upload a list of points and drive through it.", no_args_is_help=True, rich_markup_mode=None
    )
    verbs.command("upload", epilog=examples("regista mission upload field.json") + f"\n\n\b\nForm:\n{FORM}")(upload)
    verbs.command("show", epilog=examples("regista mission show --json"))(show)
    verbs.command("start", epilog=examples("regista mission start --power position2d:0"))(start)
    verbs.command("pause", epilog=examples("regista mission pause"))(pause)
    verbs.command("resume", epilog=examples("regista mission resume"))(resume)
    verbs.command("go-on", epilog=examples("regista mission go-on"))(go_on)
    verbs.command("cancel", epilog=examples("regista mission cancel"))(cancel)
    app.add_typer(verbs, name="mission")
