# SPDX-License-Identifier: Apache-2.0
"""Reads MCAP files, also those that end in the middle."""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

# What StreamReader raises at the end of a file that was cut, by where it was cut.
CUT = (McapError, struct.error, ValueError, EOFError, ZstdError)


@dataclass(frozen=True)
class Record:
    """One recorded message."""

    topic: str
    schema: str
    schema_data: dict[str, Any]
    metadata: dict[str, str]
    log_time_ns: int
    """Since the epoch: when it was read."""
    publish_time_ns: int
    """Since the epoch: the server's stamp."""
    message: dict[str, Any]


class Recording:
    """The messages of an MCAP file, in the order in which they came: iterate over it.

    `complete` is False after reading a file that was cut: by a power failure, a full disk, or because it is still being
    written.

    Raises:
        OSError: It cannot be opened.
        ValueError: It is no MCAP file.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.complete = True
        with self.path.open("rb") as file:
            if file.read(8) != b"\x89MCAP0\r\n":
                raise ValueError(f"{self.path} is no MCAP file")

    def __iter__(self) -> Iterator[Record]:
        self.complete = True
        with self.path.open("rb") as file:
            yield from self._records(file)

    def span(self) -> tuple[int, int, int]:
        """Number of messages, and the times of the first and the last [ns since the epoch]. Reads the whole file when
        it has no summary."""
        with self.path.open("rb") as file:
            try:
                summary = make_reader(file).get_summary()
            except CUT:
                summary = None
        if summary is not None and summary.statistics is not None:
            statistics = summary.statistics
            return statistics.message_count, statistics.message_start_time, statistics.message_end_time
        count, first, last = 0, 0, 0
        for record in self:
            first = first if count else record.log_time_ns
            last = record.log_time_ns
            count += 1
        return count, first, last

    def _records(self, file: IO[bytes]) -> Iterator[Record]:
        schemas: dict[int, tuple[str, dict[str, Any]]] = {}
        channels: dict[int, Channel] = {}
        records = StreamReader(file, validate_crcs=True).records
        while True:
            try:
                record = next(records)
            except StopIteration:
                return
            except CUT:
                self.complete = False
                return
            if isinstance(record, Schema):
                schemas[record.id] = (record.name, _json_schema(record))
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                if channel.message_encoding != "json":
                    continue
                name, schema = schemas.get(channel.schema_id, ("", {}))
                yield Record(
                    topic=channel.topic,
                    schema=name,
                    schema_data=schema,
                    metadata=channel.metadata,
                    log_time_ns=record.log_time,
                    publish_time_ns=record.publish_time,
                    message=json.loads(record.data),
                )


def _json_schema(schema: Schema) -> dict[str, Any]:
    return json.loads(schema.data) if schema.encoding == "jsonschema" else {}
