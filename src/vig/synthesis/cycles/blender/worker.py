"""The process that Blender runs in: `python worker.py FOLDER`, scenes on standard input, pictures on output.

Both are streams of `wire` messages; the first that goes out tells Blender's version. FOLDER holds temporary
files and is removed at the end. The process ends when its input does, when its parent has gone, or when a
scene takes longer than the header's `timeout` seconds (SIGALRM, which ends it even in the middle of
Blender's own code).
"""

from __future__ import annotations

import io
import os
import select
import shutil
import signal
import sys
import traceback
from pathlib import Path
from typing import BinaryIO

import wire

PATIENCE = 5.0
"""Seconds between looks whether the parent is still there; its end of the pipe may live on in a fork."""


def main() -> None:
    """Serve scenes until the input ends."""
    parent = os.getppid()
    requests, replies = own_streams()
    folder = Path(sys.argv[1])
    import tracing  # from here on Blender writes to what it takes for standard output

    try:
        wire.send(replies, {"blender": tracing.version()}, {})
        while waits(requests, parent):
            serve(requests, replies, folder)
    except (EOFError, BrokenPipeError):
        pass
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(0)  # Blender has nothing to save, and its own end sometimes crashes


def own_streams() -> tuple[io.FileIO, BinaryIO]:
    """The pipes, moved to descriptors of their own; what else is printed goes to standard error."""
    requests, replies = io.FileIO(os.dup(0), "r"), os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nowhere, 0)
    os.dup2(2, 1)
    return requests, replies


def waits(requests: io.FileIO, parent: int) -> bool:
    """Wait for a message; False when the parent has gone."""
    while not select.select([requests], [], [], PATIENCE)[0]:
        if os.getppid() != parent:
            return False
    return True


def serve(requests: io.FileIO, replies: BinaryIO, folder: Path) -> None:
    """Answer one scene: its arrays, or the error that it ended in."""
    import tracing

    header, arrays = wire.receive(requests)
    signal.alarm(header["timeout"])
    try:
        answer, results = tracing.trace(header, arrays, folder)
    except Exception:
        answer, results = {"error": traceback.format_exc(limit=-1)}, {}
    signal.alarm(0)
    wire.send(replies, answer, results)


if __name__ == "__main__":
    main()
