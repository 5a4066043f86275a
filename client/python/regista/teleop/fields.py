# SPDX-License-Identifier: Apache-2.0
"""The numbers of a message in a row, for the page to draw and plot."""

from __future__ import annotations

import functools
import importlib
import typing
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any

from regista import localize
from regista.message import Data, Struct

Values = Callable[[Data], Sequence[float]]


@functools.cache
def data_kinds(interface: str) -> tuple[type[Data], ...]:
    """The data messages of an interface that have numbers; empty when this version does not know it."""
    try:
        module = importlib.import_module(f"regista.{interface}")
    except ModuleNotFoundError:
        return ()
    found = [kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, Data)]
    return tuple(kind for kind in found if hasattr(kind, "SUBTYPE") and numbers(kind)[0])


def numbers(kind: Any) -> tuple[tuple[str, ...], Values]:
    """The paths of the numbers of a message, such as "pose.x", and what reads them all.

    Lists have no fixed place in a row and are left out, but for the likeliest hypothesis of where a robot is.
    """
    if kind is localize.State:
        return _HYPOTHESIS, _hypothesis
    paths = tuple(_paths(kind))
    if not paths:
        return (), lambda _: ()
    if len(paths) == 1:
        return paths, lambda message: (getattr(message, paths[0]),)  # of one alone, attrgetter makes no row
    return paths, typing.cast(Values, attrgetter(*paths))


def _paths(kind: Any, prefix: str = "") -> list[str]:
    found: list[str] = []
    for name, hint in typing.get_type_hints(kind).items():
        if isinstance(hint, type) and issubclass(hint, Struct):
            found += _paths(hint, f"{prefix}{name}.")
        elif isinstance(hint, type) and issubclass(hint, int | float):
            found.append(prefix + name)
    return found


_HYPOTHESIS = ("mean.x", "mean.y", "mean.heading", "var.x", "var.y", "var.heading", "cov.xy")


def _hypothesis(message: Data) -> Sequence[float]:
    state = typing.cast(localize.State, message)
    if not state.hypotheses:
        return (float("nan"),) * len(_HYPOTHESIS)
    best = max(state.hypotheses, key=lambda hypothesis: hypothesis.weight)
    xx, yy, aa, xy = best.covariance[:4]
    return (best.mean.x, best.mean.y, best.mean.heading, xx, yy, aa, xy)
