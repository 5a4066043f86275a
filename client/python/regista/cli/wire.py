# SPDX-License-Identifier: Apache-2.0
"""`regista wire`: Player's wire format as JSON, and back."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from typing import Annotated, Any

import typer

import regista

from . import common
from .common import examples

wire = typer.Typer(help="Player's wire format as JSON, and back.", rich_markup_mode=None, no_args_is_help=True)


@wire.command(
    epilog=examples(
        "regista wire decode 0100007f00001a090000000400000000000000040000000200000000000000000000000000000000",
        "regista wire decode < messages.hex | regista wire encode",
    )
)
def decode(
    messages: Annotated[
        list[str] | None, typer.Argument(metavar="HEX", help="Whole messages, header and body.")
    ] = None,
) -> None:
    """Messages in hex, from the arguments or one a line from standard input, to JSON."""

    def convert(text: str) -> str:
        return "\n".join(json.dumps(message) for message in regista.wire.decode(bytes.fromhex(text)))

    _convert(messages or sys.stdin, convert, "argument" if messages else "line")


@wire.command(epilog=examples("regista wire decode < messages.hex | regista wire encode"))
def encode() -> None:
    """JSON, one message a line from standard input, to hex. Counts and the header's size may be left out."""

    def convert(text: str) -> str:
        return bytes(regista.wire.encode(json.loads(text))).hex()

    _convert(sys.stdin, convert, "line")


def _convert(texts: Iterable[str], convert: Any, place: str) -> None:
    """One at a time, because we may stand in a pipe. What is wrong is told and left out."""
    good = True
    for number, text in enumerate(texts, 1):
        if not text.strip():
            continue
        try:
            result = convert(text.strip())
        except (ValueError, TypeError, RecursionError, regista.Error) as error:
            common.note(f"{place} {number}: {error}")
            good = False
            continue
        sys.stdout.write(result + "\n")
        sys.stdout.flush()
    if not good:
        raise typer.Exit(common.FAILED)


def add_to(app: typer.Typer) -> None:
    app.add_typer(wire, name="wire")
