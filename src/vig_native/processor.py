"""Instruction sets of this processor; run as a program, the widest."""

from __future__ import annotations

from pathlib import Path

NEEDED = {
    "avx512": ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl", "avx2", "fma"),
    "avx2": ("avx2", "fma"),
}
"""Flags of the processor that each set but "plain" takes, the widest first."""


def instruction_sets(cpuinfo: Path = Path("/proc/cpuinfo")) -> list[str]:
    """Return the instruction sets of the native library, the widest first; "plain" runs anywhere."""
    try:
        lines = cpuinfo.read_text().splitlines()
    except OSError:
        lines = []
    flags = next((line.split() for line in lines if line.startswith("flags")), [])
    return [name for name, needed in NEEDED.items() if set(needed) <= set(flags)] + ["plain"]


if __name__ == "__main__":
    print(instruction_sets()[0])
