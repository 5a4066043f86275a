# SPDX-License-Identifier: Apache-2.0
"""`regista plot`: pictures of a recording. Needs matplotlib, the extra `plot`."""

from __future__ import annotations

import importlib
import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer

from ..recording import Recording
from . import common
from .common import examples

USUAL = (r"position2d:\d+\.velocity\.", r"power:\d+\.(voltage_v|charge_percent)")  # drawn when nothing is named
UNIT = re.compile(r"^\[([^]]+)\]")


@dataclass
class Series:
    """One number of one device over time."""

    unit: str = ""
    times: list[float] = field(default_factory=list)  # s since the first message
    values: list[float] = field(default_factory=list)


def read_series(recording: Recording) -> dict[str, Series]:
    """All numbers of all devices, by names such as "position2d:0.velocity.x"."""
    series: dict[str, Series] = {}
    began: int | None = None
    for record in recording:
        device = record.metadata.get("device")
        began = record.log_time_ns if began is None else began
        if device is None or record.metadata.get("kind") != "data":
            continue
        seconds = (record.log_time_ns - began) * 1e-9
        for name, value, unit in _numbers(device, record.message, record.schema_data):
            known = series.setdefault(name, Series(unit))
            known.times.append(seconds)
            known.values.append(value)
    return series


def _numbers(prefix: str, value: Any, schema: dict[str, Any]) -> list[tuple[str, float, str]]:
    if isinstance(value, dict):
        properties = schema.get("properties", {})
        return [
            number
            for key, inner in value.items()
            for number in _numbers(f"{prefix}.{key}", inner, properties.get(key, {}))
        ]
    if isinstance(value, bool) or not (isinstance(value, (int, float)) or value in ("nan", "inf", "-inf")):
        return []
    unit = UNIT.match(schema.get("description", ""))
    return [(prefix, float(value), unit.group(1) if unit else "")]


def choose(series: dict[str, Series], wanted: list[str], path: Path) -> list[list[str]]:
    """The curves of each time plot: those of one device and unit share one."""
    for name in wanted:
        if name not in series:
            common.fail(common.FAILED, f"{path} has no {name}; it has {', '.join(sorted(series)) or 'no numbers'}")
    names = wanted or [n for pattern in USUAL for n in series if re.match(pattern, n)]
    plots: dict[tuple[str, str], list[str]] = {}
    for name in names:
        plots.setdefault((name.partition(".")[0], series[name].unit), []).append(name)
    return list(plots.values())


def draw(series: dict[str, Series], plots: list[list[str]], trajectories: list[str], title: str) -> Any:
    """The figure: trajectories at the left, time plots at the right."""
    from matplotlib.figure import Figure

    columns = [width for width, wanted in ((5.0, trajectories), (7.0, plots)) if wanted]
    rows = max(1, len(plots))
    figure = Figure(figsize=(sum(columns), max(4.5, 1.9 * rows + 0.8)), layout="constrained")
    figure.suptitle(title)
    grid = figure.add_gridspec(rows, len(columns), width_ratios=columns)
    if trajectories:
        _draw_trajectories(figure.add_subplot(grid[:, 0]), series, trajectories)
    first: Any = None
    for row, names in enumerate(plots):
        axes = figure.add_subplot(grid[row, -1], sharex=first)
        first = first or axes
        for name in names:
            axes.plot(series[name].times, series[name].values, linewidth=1.2, label=name.partition(".")[2])
        device, unit = names[0].partition(".")[0], series[names[0]].unit
        axes.set_ylabel(f"{device} [{unit}]" if unit else device)
        axes.grid(alpha=0.3)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize="small")
        if row < rows - 1:
            axes.tick_params(labelbottom=False)
        else:
            axes.set_xlabel("time [s]")
    return figure


def _draw_trajectories(axes: Any, series: dict[str, Series], devices: list[str]) -> None:
    for number, device in enumerate(devices):
        x, y = series[f"{device}.pose.x"].values, series[f"{device}.pose.y"].values
        headings = series[f"{device}.pose.heading"].values
        color = f"C{number}"
        axes.plot(x, y, color=color, linewidth=1.4, label=device)
        axes.plot(x[0], y[0], "o", color=color, markerfacecolor="white", label="begin")
        axes.plot(x[-1], y[-1], "o", color=color, label="end")
        axes.quiver(
            *zip(*_arrows(x, y, headings), strict=True), color=color, alpha=0.6, angles="xy", width=0.007, scale=20
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.grid(alpha=0.3)
    axes.legend(loc="best", fontsize="small")


def _arrows(x: list[float], y: list[float], headings: list[float], count: int = 16) -> list[tuple[float, ...]]:
    """Where it looked, at equal distances along the way."""
    length = [0.0]
    for i in range(1, len(x)):
        length.append(length[-1] + math.hypot(x[i] - x[i - 1], y[i] - y[i - 1]))
    due = 0.0
    arrows: list[tuple[float, ...]] = []
    for i, way in enumerate(length):
        if way >= due:
            arrows.append((x[i], y[i], math.cos(headings[i]), math.sin(headings[i])))
            due += max(length[-1] / count, 1e-9)
    return arrows


def _has_matplotlib() -> bool:
    try:
        importlib.import_module("matplotlib.figure")
    except ImportError:
        return False
    return True


def plot(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="An MCAP file of `regista record`.")],
    fields: Annotated[
        list[str] | None,
        typer.Argument(metavar="FIELD", help="What to draw over time, such as power:0.voltage_v."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="PICTURE", help="PNG, SVG or PDF; default: FILE.svg.")
    ] = None,
) -> None:
    """Draw a recording.

    Where each base went, and numbers over time."""
    if not _has_matplotlib():
        common.fail(common.FAILED, "plot needs matplotlib; install it with: pip install 'regista[plot]'")
    recording = Recording(file)
    series = read_series(recording)
    plots = choose(series, fields or [], file)
    trajectories = [] if fields else [n.removesuffix(".pose.x") for n in series if n.endswith(".pose.x")]
    trajectories = [device for device in trajectories if device.startswith("position2d:")]
    if not plots and not trajectories:
        common.fail(common.FAILED, f"{file} holds nothing to draw; name a field: {', '.join(sorted(series)) or 'none'}")
    target = output or file.with_suffix(".svg")
    figure = draw(series, plots, trajectories, file.name)
    try:
        figure.savefig(target, dpi=150)
    except ValueError as error:  # "Format 'xyz' is not supported (supported formats: …)"
        common.fail(common.USAGE, f"--output {target}: {error}")
    common.note(f"{target}: {sum(len(each.values) for each in series.values())} numbers")
    if not recording.complete:
        common.note(f"{file} ends in the middle; drawn is what came before")


def add_to(app: typer.Typer) -> None:
    app.command(
        "plot",
        epilog=examples("regista plot lap.mcap", "regista plot lap.mcap position2d:0.velocity.x -o speed.png"),
    )(plot)
