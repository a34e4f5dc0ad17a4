"""Names of machines, read from the files of systems that state them."""

import platform
from pathlib import Path

from vig.io.machine import processor


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_the_processor_is_the_model_else_the_board_else_the_architecture(tmp_path: Path) -> None:
    named = platform.processor() or platform.machine()
    assert processor(tmp_path) == named
    write(tmp_path / "proc/cpuinfo", "processor\t: 0\nCPU implementer\t: 0x41\nCPU part\t: 0xd0b\n")  # arm64
    assert processor(tmp_path) == named
    write(tmp_path / "proc/device-tree/model", "Raspberry Pi 5 Model B Rev 1.0\0")
    assert processor(tmp_path) == "Raspberry Pi 5 Model B Rev 1.0"
    write(tmp_path / "proc/cpuinfo", "processor\t: 0\nmodel name\t: Intel(R) Xeon(R)\n")
    assert processor(tmp_path) == "Intel(R) Xeon(R)"
