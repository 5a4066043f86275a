# SPDX-License-Identifier: Apache-2.0
"""Writes messages to an MCAP file, on a thread of its own."""

from __future__ import annotations

import collections
import contextlib
import errno
import json
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, cast

from mcap.writer import CompressionType, Writer

from . import foxglove

CHUNK_BYTES = 64 * 1024
CHUNK_SECONDS = 0.5  # half of what a power cut may cost, so that a slow disk has the other half
QUEUE_BYTES = 8 * 1024 * 1024
RETRY_SECONDS = 0.5


@dataclass(frozen=True)
class Channel:
    """One kind of message of one device: a topic of the file."""

    topic: str
    schema_name: str
    schema: dict[str, Any] = field(compare=False)
    metadata: dict[str, str] = field(default_factory=dict, compare=False)


LOG = Channel("/log", "foxglove.Log", foxglove.LOG)


class _Buffer:
    """What the MCAP writer takes for its file: holds the bytes that are not stored yet."""

    def __init__(self) -> None:
        self.pending = bytearray()
        self._stored = 0

    def write(self, data: bytes) -> int:
        self.pending += data
        return len(data)

    def tell(self) -> int:
        return self._stored + len(self.pending)

    def flush(self) -> None:
        pass

    def stored(self) -> None:
        self._stored += len(self.pending)
        self.pending.clear()

    @property
    def size(self) -> int:
        """Of what is in the file [bytes]."""
        return self._stored


def _synchronise_folder(folder: Path) -> None:
    """A file whose name is lost in a power cut is lost, too."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:  # not every file system can
            raise
    finally:
        os.close(descriptor)


class Recorder:
    """An MCAP file that grows while a robot is read.

    `put()` never waits for the disk: it queues at most 8 MiB and drops what does not fit. A thread writes chunks of
    at most 64 KiB or half a second, each synchronised to the disk before the next begins, so that what is older than
    a second survives a power cut.

    A full disk stops the recording, not the program: what comes meanwhile is dropped and counted, `on_notice` is
    told, and the recording goes on when there is space. The file can be read at any time.

    Args:
        path: Must not exist yet, unless `overwrite`; a device such as `/dev/full` may.
        overwrite: Begin the file anew.
        on_notice: Called with a text, on the recorder's thread, when the recording stops or goes on.

    Raises:
        FileExistsError: It is there already.
    """

    def __init__(
        self, path: str | os.PathLike[str], *, overwrite: bool = False, on_notice: Callable[[str], None] | None = None
    ) -> None:
        exclusive = 0 if overwrite or Path(path).is_char_device() else os.O_EXCL
        flags = os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC | (os.O_TRUNC if overwrite else exclusive)
        self._file = os.open(path, flags, 0o666)
        _synchronise_folder(Path(path).parent)
        self._on_notice = on_notice or (lambda _: None)
        self._queue: collections.deque[tuple[Channel, int, int, bytes]] = collections.deque()
        self._queued_bytes = 0
        self._dropped = 0
        self._written = 0
        self._closing = False
        self._condition = threading.Condition()
        self._buffer = _Buffer()
        self._writer = Writer(cast(IO[bytes], self._buffer), chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._channels: dict[Channel, int] = {}
        self._schemas: dict[str, int] = {}
        self._chunk_began: float | None = None  # monotonic [s]; None: the chunk is empty
        self._trouble: OSError | None = None
        self._dropped_before = 0  # when the trouble began
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    # The reader's thread.

    def put(self, channel: Channel, message: dict[str, Any], log_time_ns: int, publish_time_ns: int) -> bool:
        """Record a message. False: it was dropped, because the disk is full or slow.

        Args:
            channel: Which topic.
            message: What the channel's schema describes, such as what `write()` returns.
            log_time_ns: When it was read here, since the epoch.
            publish_time_ns: The server's stamp, since the epoch.
        """
        data = json.dumps(message, separators=(",", ":")).encode()
        with self._condition:
            if self._trouble is not None or self._queued_bytes + len(data) > QUEUE_BYTES:
                self._dropped += 1
                return False
            self._queue.append((channel, log_time_ns, publish_time_ns, data))
            self._queued_bytes += len(data)
            self._condition.notify()
        return True

    @property
    def written(self) -> int:
        """Messages that are in the file or in the chunk that is being filled."""
        return self._written

    @property
    def dropped(self) -> int:
        """Messages."""
        return self._dropped

    @property
    def size(self) -> int:
        """Of the file [bytes]."""
        return self._buffer.size

    @property
    def trouble(self) -> OSError | None:
        """Why nothing is written at present."""
        return self._trouble

    def close(self) -> OSError | None:
        """Write what waits, the index, and close. What could not be written, if so."""
        with self._condition:
            self._closing = True
            self._condition.notify()
        self._thread.join()
        os.close(self._file)
        return self._trouble

    # The recorder's thread.

    def _run(self) -> None:
        self._writer.start(profile="regista", library="regista")
        self._store()
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._queue or self._closing, timeout=self._patience())
                item = self._queue.popleft() if self._queue else None
                if item is not None:
                    self._queued_bytes -= len(item[-1])
            if item is not None:
                self._write(*item)
            elif self._closing:
                break
            if self._trouble is not None:
                self._store()
            elif self._chunk_began is not None and time.monotonic() - self._chunk_began >= CHUNK_SECONDS:
                self._writer.flush()  # type: ignore[no-untyped-call]
                self._store()
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._store()

    def _patience(self) -> float | None:
        if self._trouble is not None:
            return RETRY_SECONDS
        if self._chunk_began is None:
            return None
        return max(0.0, self._chunk_began + CHUNK_SECONDS - time.monotonic())

    def _write(self, channel: Channel, log_time_ns: int, publish_time_ns: int, data: bytes) -> None:
        if self._trouble is not None:  # the chunk that waits is all that is kept
            with self._condition:
                self._dropped += 1
            return
        self._writer.add_message(self._channel_id(channel), log_time_ns, data, publish_time_ns)
        self._written += 1
        if self._chunk_began is None:
            self._chunk_began = time.monotonic()
        if self._buffer.pending:  # the chunk was full
            self._store()

    def _channel_id(self, channel: Channel) -> int:
        if channel not in self._channels:
            if channel.schema_name not in self._schemas:
                self._schemas[channel.schema_name] = self._writer.register_schema(
                    channel.schema_name, "jsonschema", json.dumps(channel.schema).encode()
                )
            self._channels[channel] = self._writer.register_channel(
                channel.topic, "json", self._schemas[channel.schema_name], channel.metadata
            )
        return self._channels[channel]

    def _store(self) -> None:
        """All that is pending, or nothing: the file never ends within a chunk because the disk was full."""
        self._chunk_began = None
        try:
            view = memoryview(bytes(self._buffer.pending))
            while view:
                view = view[os.write(self._file, view) :]
            self._synchronise()
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._buffer.size)
                os.lseek(self._file, self._buffer.size, os.SEEK_SET)
            self._stop(error)
        else:
            self._buffer.stored()
            self._resume()

    def _synchronise(self) -> None:
        try:
            os.fdatasync(self._file)
        except OSError as error:
            if error.errno != errno.EINVAL:  # a pipe cannot, and need not
                raise

    def _stop(self, error: OSError) -> None:
        if self._trouble is None:
            with self._condition:
                self._dropped_before = self._dropped
                self._trouble = error
            self._on_notice(f"log stopped: {error.strerror}")
        self._trouble = error

    def _resume(self) -> None:
        if self._trouble is None:
            return
        with self._condition:
            error, self._trouble = self._trouble, None
            dropped = self._dropped - self._dropped_before
        count = f"{dropped:,}".replace(",", " ")
        text = f"log stopped: {error.strerror}, {count} messages dropped"
        self._on_notice(text + "; going on")
        now = time.time_ns()
        self.put(LOG, foxglove.log(now, foxglove.WARNING, text), now, now)
