# SPDX-License-Identifier: Apache-2.0
"""Recordings of robots: MCAP files of JSON messages, which Foxglove, Lichtblick and PlotJuggler open."""

from .log import Log
from .reader import Record, Recording
from .schema import answer_class, data_class, descriptions, read, reply_class, schema, text, write
from .writer import LOG, Channel, Recorder

__all__ = [
    "LOG",
    "Channel",
    "Log",
    "Record",
    "Recorder",
    "Recording",
    "answer_class",
    "data_class",
    "descriptions",
    "read",
    "reply_class",
    "schema",
    "text",
    "write",
]
