"""Blender's process: `python worker.py THREADS FOLDER`, scenes on standard input, pictures on its output.

Both are streams of `wire` messages; the first one sent holds Blender's version. FOLDER holds temporary
files and is removed at the end. The process ends when its input or its parent does, even during a
scene, and when a scene takes longer than the header's `timeout` seconds (SIGALRM, which ends it
whatever Blender is doing).
"""

from __future__ import annotations

import contextlib
import io
import os
import select
import shutil
import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import wire

PATIENCE = 2.0
"""Seconds between checks that the parent is alive; its end of the pipe may be held open by a fork."""


def main() -> None:
    """Serve scenes until the input ends."""
    parent, threads, folder = os.getppid(), int(sys.argv[1]), Path(sys.argv[2])
    requests, replies = own_streams()
    threading.Thread(target=watch, args=(requests, parent, folder), daemon=True).start()
    with few_processors(threads):
        import tracing  # Blender writes to standard output from here on

    try:
        wire.send(replies, {"blender": tracing.version()}, {})
        while True:
            serve(requests, replies, threads, folder)
    except (EOFError, BrokenPipeError):
        leave(folder)


def own_streams() -> tuple[io.FileIO, BinaryIO]:
    """Return the pipes, moved to descriptors of their own; other output goes to standard error."""
    requests, replies = io.FileIO(os.dup(0), "r"), os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nowhere, 0)
    os.dup2(2, 1)
    return requests, replies


@contextlib.contextmanager
def few_processors(count: int) -> Iterator[None]:
    """Let this process see `count` processors only, where the system can.

    When it is loaded, Blender makes its pools of threads as large as their number. Larger ones than a worker
    is to use spin in the way of the workers beside it: half as much processor time again.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(allowed)[:count])
    try:
        yield
    finally:
        for thread in os.listdir("/proc/self/task"):
            with contextlib.suppress(ProcessLookupError):
                os.sched_setaffinity(int(thread), allowed)


def watch(requests: io.FileIO, parent: int, folder: Path) -> None:
    """Exit as soon as the pipe is closed; Cycles lets other threads run while it renders."""
    hung_up = select.poll()
    hung_up.register(requests, 0)
    while not hung_up.poll(1000 * PATIENCE) and os.getppid() == parent:
        pass
    leave(folder)


def leave(folder: Path) -> None:
    """Remove the temporary files and end at once: Blender has nothing to save."""
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(0)


def serve(requests: io.FileIO, replies: BinaryIO, threads: int, folder: Path) -> None:
    """Answer one scene: its arrays, or the error raised."""
    import tracing

    header, arrays = wire.receive(requests)
    signal.alarm(header["timeout"])
    try:
        answer, results = tracing.trace(header, arrays, threads, folder)
    except Exception:
        answer, results = {"error": traceback.format_exc(limit=-1)}, {}
    signal.alarm(0)
    wire.send(replies, answer, results)


if __name__ == "__main__":
    main()
