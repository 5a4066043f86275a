# SPDX-License-Identifier: Apache-2.0
"""The command itself: its verbs, and how its errors end."""

from __future__ import annotations

import importlib.metadata
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import regista

from . import bench, change, common, doctor, drive, joy, look, mission, plot, record, replay, teleop, wire

EXIT_CODES = """\
Exit codes:
  0    done
  1    it failed, or the doctor found something
  2    wrong usage
  3    cannot connect
  4    refused, or somebody else drives
  5    no answer in time
  130  interrupted (Ctrl-C)"""


class Verbs(TyperGroup):
    """Ends errors with a text and the exit code that scripts rely on."""

    def invoke(self, ctx: Any) -> Any:
        try:
            with common.quiet_pipe():
                return super().invoke(ctx)
        except regista.ConnectionError as error:
            common.fail(common.CANNOT_CONNECT, f"{error}{_remedy(error)}")
        except regista.TimeoutError as error:
            common.fail(common.TIMEOUT, str(error))
        except regista.RefusedError as error:
            common.fail(common.REFUSED, str(error))
        except (regista.Error, ValueError) as error:
            common.fail(common.FAILED, str(error))
        except OSError as error:
            place = f"{error.filename}: " if error.filename is not None else ""
            common.fail(common.FAILED, f"{place}{error.strerror or error}")


def _remedy(error: regista.Error) -> str:
    if error.asked != "connect":
        return ""
    return "\nIs regista-server running there? Name another robot with --robot HOST[:PORT] or REGISTA_ROBOT."


app = typer.Typer(
    cls=Verbs,
    name="regista",
    help="Look at a robot, drive it, record it.",
    epilog=f"\b\n{EXIT_CODES}\n\n\b\nExamples:\n"
    "  regista list\n"
    "  regista print position2d --rate 5\n"
    "  regista drive --robot robot7\n"
    "  regista record lap.mcap --for 60",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
)


def _version(wanted: bool) -> None:
    if wanted:
        sys.stdout.write(f"regista {importlib.metadata.version('regista')}\n")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    pass


for module in (look, doctor, change, drive, mission, joy, teleop, record, replay, plot, bench, wire):
    module.add_to(app)


def main() -> None:
    """The entry point."""
    app(prog_name="regista")
