"""The client of the process that Blender runs in."""

import contextlib
import os
import shutil
import subprocess
import tempfile
import threading
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from vig_world.renderers.cycles.blender import wire

GRACE = 10.0  # seconds that a worker may take longer than its own alarm before it is killed from here


class WorkerDiedError(Exception):
    """The worker ended without an answer; the message holds the last line of its log."""


class BlenderProcess:
    """One process that answers `wire` messages; it ends with this one, even if that is killed.

    Args:
        command: Command to run; a folder for temporary files is added as last argument.
        start_timeout: Seconds until it has sent its first header, which is kept as `hello`.

    Raises:
        WorkerDiedError: When it ended or did not answer in time.
    """

    def __init__(self, command: Sequence[str], start_timeout: float = 60.0) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="vig-cycles-"))
        self._log = (self._folder / "log").open("wb+")
        environment = {
            key: value
            for key, value in os.environ.items()
            if key not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "__PYVENV_LAUNCHER__")
        }
        self._process = subprocess.Popen(
            [*command, str(self._folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            env=environment,
            start_new_session=True,  # the parent handles Ctrl-C; a scene in progress is finished
        )
        self._end = weakref.finalize(self, _end, self._process, self._log, self._folder)
        self.hello = self._answer(start_timeout)[0]

    def ask(
        self, header: dict[str, Any], arrays: dict[str, np.ndarray], timeout: float
    ) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Send a message and wait for the answer, at most `timeout` seconds.

        The header goes out with `timeout`, in whole seconds, for the worker's own alarm.

        Raises:
            WorkerDiedError: When no answer came; this worker cannot be used again.
        """
        message = {**header, "timeout": int(np.ceil(timeout))}
        with self._limit(timeout + GRACE):
            try:
                wire.send(_pipe(self._process.stdin), message, arrays)
            except OSError:
                self._fail()
        return self._answer(timeout + GRACE)

    def close(self) -> None:
        """End the process and remove its files."""
        self._end()

    def _answer(self, timeout: float) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        with self._limit(timeout):
            try:
                return wire.receive(self._process.stdout)  # type: ignore[arg-type]
            except (EOFError, OSError):
                self._fail()
        raise AssertionError

    @contextlib.contextmanager
    def _limit(self, seconds: float) -> Iterator[None]:
        timer = threading.Timer(seconds, self._process.kill)
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()

    def _fail(self) -> None:
        self._process.kill()
        code = self._process.wait()
        self._log.seek(0)
        lines = [line for line in self._log.read().decode(errors="replace").splitlines() if line.strip()]
        self.close()
        ended = f"was ended by signal {-code}" if code < 0 else f"ended with code {code}"
        raise WorkerDiedError(f"{ended}; last line of its log: {lines[-1].strip()}" if lines else ended)


def _pipe(stream: Any) -> BinaryIO:
    assert stream is not None
    return stream


def _end(process: subprocess.Popen[bytes], log: BinaryIO, folder: Path) -> None:
    process.kill()
    process.wait()
    for stream in (process.stdin, process.stdout, log):
        with contextlib.suppress(OSError):
            _pipe(stream).close()
    shutil.rmtree(folder, ignore_errors=True)
