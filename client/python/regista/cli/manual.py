# SPDX-License-Identifier: Apache-2.0
"""The manual of the command, from the same texts as --help: man pages and a page in Markdown.

python -m regista.cli.manual man FOLDER      regista.1, regista-list.1, …
python -m regista.cli.manual markdown        to standard output: docs/command-line.md
"""

from __future__ import annotations

import importlib.metadata
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from .app import app


@dataclass(frozen=True)
class Page:
    """What --help says of one verb."""

    name: str  # "regista wire decode"
    usage: str
    text: str
    options: list[tuple[str, str]]
    sections: list[tuple[str, list[str]]]  # "Examples", and its lines
    verbs: list[tuple[str, str]]


def pages() -> Iterator[Page]:
    """The command and all its verbs."""
    yield from _pages(typer.main.get_command(app), "regista", None)


def _pages(command: Any, name: str, parent: Any) -> Iterator[Page]:
    context = command.make_context(name, [], parent=parent, resilient_parsing=True)
    commands = getattr(command, "commands", {})
    yield Page(
        name=name,
        usage=" ".join(command.collect_usage_pieces(context)),
        text=(command.help or "").strip(),
        options=[record for option in command.get_params(context) if (record := option.get_help_record(context))],
        sections=_sections(command.epilog or ""),
        verbs=[(verb, _first_line(inner.help)) for verb, inner in commands.items()],
    )
    for verb, inner in commands.items():
        yield from _pages(inner, f"{name} {verb}", context)


def _first_line(text: str | None) -> str:
    return (text or "").strip().partition("\n")[0]


def _sections(epilog: str) -> list[tuple[str, list[str]]]:
    sections = []
    for block in epilog.split("\b\n")[1:]:
        title, *lines = block.strip("\n").split("\n")
        sections.append((title.rstrip(":"), lines))
    return sections


def markdown() -> str:
    """One page with all verbs."""
    out = [
        "# The command line\n",
        "The texts of `--help` on one page. `regista --install-completion` teaches your shell the verbs;\n"
        "`python -m regista.cli.manual man FOLDER` writes man pages.\n",
    ]
    for page in pages():
        out.append(f"## {page.name}\n")
        out.append(f"{page.text}\n\n```text\n{page.name} {page.usage}\n```\n")
        if page.verbs:
            out.append("| | |\n|---|---|")
            out += [f"| `{verb}` | {_cell(text)} |" for verb, text in page.verbs]
            out.append("")
        if page.options:
            out.append("| | |\n|---|---|")
            out += [f"| `{_cell(names)}` | {_cell(text)} |" for names, text in page.options]
            out.append("")
        for title, lines in page.sections:
            shell = "sh" if title == "Examples" else "text"
            body = "\n".join(line.removeprefix("  ") for line in lines)
            out.append(f"{title}:\n\n```{shell}\n{body}\n```\n")
    return "\n".join(out)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def man(page: Page) -> str:
    """In the macros of man(7)."""
    title = page.name.replace(" ", "-")
    version = importlib.metadata.version("regista")
    out = [
        f'.TH {title.upper()} 1 "" "regista {version}" "regista"',
        ".SH NAME",
        f"{title} \\- {_roff(_first_line(page.text).rstrip('.'))}",
        ".SH SYNOPSIS",
        f".B {_roff(page.name)}",
        _roff(page.usage),
        ".SH DESCRIPTION",
        *(".PP\n" + _roff(" ".join(part.split())) for part in page.text.split("\n\n")),
    ]
    if page.verbs:
        out.append(".SH VERBS")
        out += [f".TP\n.B {_roff(verb)}\n{_roff(text)}" for verb, text in page.verbs]
    if page.options:
        out.append(".SH OPTIONS")
        out += [f".TP\n.B {_roff(names)}\n{_roff(text)}" for names, text in page.options]
    for heading, lines in page.sections:
        out += [f".SH {heading.upper()}", ".nf", *(_roff(line) for line in lines), ".fi"]
    return "\n".join(out) + "\n"


def _roff(text: str) -> str:
    """groff_char(7): what would be read as a request or an escape."""
    escaped = text.replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + escaped if escaped.startswith((".", "'")) else escaped


def main(arguments: list[str]) -> int:
    match arguments:
        case ["man", folder]:
            Path(folder).mkdir(parents=True, exist_ok=True)
            for page in pages():
                Path(folder, page.name.replace(" ", "-") + ".1").write_text(man(page))
        case ["markdown"]:
            sys.stdout.write(markdown())
        case _:
            sys.stderr.write(__doc__ or "")
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
