"""Other differentiable renderers on the same problem; each is optional (benchmarks/requirements.txt)."""

import importlib
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata, util
from types import ModuleType
from typing import Any

INSTALL = "pip install -r benchmarks/requirements.txt"


@dataclass(frozen=True)
class Peer:
    """One other renderer."""

    title: str
    package: str
    """As it is installed and imported."""
    module: str
    """Our adapter, imported only where the package is installed."""
    hint: str = INSTALL
    """What to try when it is installed but does not run."""

    def available(self) -> str | None:
        """None when it runs on this machine, else one line that says what to do.

        Tried in a process of its own: a compiler that does not support the processor aborts the process.
        """
        if util.find_spec(self.package) is None:
            return f"{self.title} is not installed; to compare with it: {INSTALL}"
        trial = subprocess.run([sys.executable, "-m", self.module], capture_output=True, text=True)
        if trial.returncode == 0:
            return None
        lines = trial.stderr.strip().splitlines() or ["no message"]
        aborted = trial.returncode < 0  # then the message comes first, else the exception comes last
        why = lines[0] if aborted else lines[-1]
        return f"{self.title} is installed but does not run here ({why}); try: {self.hint}"

    def version(self) -> str:
        """Of the installed package."""
        return metadata.version(self.package)

    def load(self) -> ModuleType:
        """Our adapter."""
        return importlib.import_module(self.module)


DEODR = Peer("DEODR", "deodr", "benchmarks.peers.deodr")
MITSUBA = Peer(
    "Mitsuba",
    "mitsuba",
    "benchmarks.peers.mitsuba",
    "apt install libllvm19, and DRJIT_LIBLLVM_PATH=/path/to/libLLVM.so.19.1",
)


def try_out(contender: Callable[[Any], Any]) -> None:
    """What an adapter does as a program: one gradient of a small case."""
    from benchmarks.case import make_case

    contender(make_case(75)).gradient(0)
