"""Build backend: scikit-build-core's, with the compiler of the package `ziglang` where a machine has none."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from scikit_build_core import build as base
from scikit_build_core.build import build_sdist as build_sdist
from scikit_build_core.build import get_requires_for_build_sdist as get_requires_for_build_sdist
from scikit_build_core.build import prepare_metadata_for_build_editable as prepare_metadata_for_build_editable
from scikit_build_core.build import prepare_metadata_for_build_wheel as prepare_metadata_for_build_wheel


def has_compiler() -> bool:
    """Return whether there is a C++ compiler that CMake finds; VIG_ZIG=1 in the environment hides it."""
    if os.environ.get("VIG_ZIG") == "1":
        return False
    return bool(os.environ.get("CXX")) or any(map(shutil.which, ("c++", "g++", "clang++")))


def _requires(config_settings: Any) -> list[str]:
    return [*base.get_requires_for_build_wheel(config_settings), *([] if has_compiler() else ["ziglang"])]


get_requires_for_build_wheel = get_requires_for_build_editable = _requires


@contextmanager
def _compiler() -> Iterator[None]:
    """Let CMake find zig's compiler and archiver where there is no other."""
    if has_compiler():
        yield
        return
    before = dict(os.environ)
    with tempfile.TemporaryDirectory() as folder:
        for name in ("c++", "ar", "ranlib"):
            script = Path(folder, name)
            script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ziglang {name} "$@"\n')
            script.chmod(0o755)
        os.environ["CXX"] = f"{folder}/c++"
        tools = f"-DVIG_ZIG=ON -DCMAKE_AR={folder}/ar -DCMAKE_RANLIB={folder}/ranlib"
        os.environ["CMAKE_ARGS"] = f"{tools} {before.get('CMAKE_ARGS', '')}".strip()
        try:
            yield
        finally:
            os.environ.clear()
            os.environ.update(before)


def build_wheel(directory: str, config_settings: Any = None, metadata_directory: str | None = None) -> str:
    """Build a wheel into a folder; its file name."""
    with _compiler():
        return base.build_wheel(directory, config_settings, metadata_directory)


def build_editable(directory: str, config_settings: Any = None, metadata_directory: str | None = None) -> str:
    """Build the native library beside its sources, and a wheel that leads to these."""
    with _compiler():
        return base.build_editable(directory, config_settings, metadata_directory)
