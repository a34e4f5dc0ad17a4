"""Native code behind its preamble."""

from pathlib import Path

import torch
import warp as wp

from vig_renderer.device import launch, native_code


@wp.kernel
def add_times(x: wp.array(dtype=wp.float32), factor: wp.float32, out: wp.array(dtype=wp.float32)):
    i = wp.tid()
    out[i] = out[i] + factor * x[i]


def test_a_launch_that_is_repeated_is_of_its_own_tensors() -> None:
    """Only the first two of a shape, stride and number are described."""
    for size in (3, 5, 3):
        for factor in (2.0, 3.0, 2.0, 2.0, 3.0):
            x, out = torch.rand(size), torch.ones(size)
            launch(add_times, size, x, factor, out)
            torch.testing.assert_close(out, 1 + factor * x)
    spaced = torch.arange(6.0)[::2]
    launch(add_times, 3, spaced, 2.0, out := torch.zeros(3))
    assert out.tolist() == [0.0, 4.0, 8.0]
    launch(add_times, 0, spaced, 2.0, out)
    assert out.tolist() == [0.0, 4.0, 8.0]


def test_constants_stand_before_the_code_with_their_types(tmp_path: Path) -> None:
    (tmp_path / "a.cc").write_text("real x = HALF;\n")
    (tmp_path / "b.cc").write_text("return x;\n")
    code = native_code(
        tmp_path, "a.cc", "b.cc", real=wp.float64, HALF=0.5, COUNT=16, ON=True, BIG=(1 << 63) - 1
    )
    assert code.splitlines() == [
        "typedef double real;",
        "constexpr real HALF = real(0.5);",
        "constexpr int COUNT = 16;",
        "constexpr bool ON = true;",
        "constexpr wp::int64 BIG = 9223372036854775807;",
        "real x = HALF;",
        "",
        "return x;",
    ]
    assert native_code(tmp_path, "b.cc", real=wp.float32).startswith("typedef float real;")
