"""Which instruction sets this processor has."""

from __future__ import annotations

import platform


def instruction_sets() -> list[str]:
    """Those that the native library is built for, the widest first; "plain" runs anywhere."""
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return ["plain"]
    try:
        from numpy._core._multiarray_umath import __cpu_features__ as has
    except ImportError:  # numpy 1.26
        from numpy.core._multiarray_umath import __cpu_features__ as has
    needed = {"avx512": ("AVX512_SKX", "AVX2", "FMA3"), "avx2": ("AVX2", "FMA3")}
    return [name for name, features in needed.items() if all(has.get(each) for each in features)] + ["plain"]
