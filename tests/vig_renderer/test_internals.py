"""Private interfaces of torch and Warp: what they tell today, and what happens when they are gone."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch
import warp as wp

from vig_renderer.device import Prepared, initialise
from vig_renderer.internals import packed_launch, transforms


@wp.struct
class Pair:
    values: wp.array(dtype=wp.float32)
    offset: wp.float32


@wp.kernel
def add_offset(pair: Pair, scale: wp.float32, out: wp.array(dtype=wp.float32)):
    i = wp.tid()
    out[i] = scale * pair.values[i] + pair.offset


def pair_of(*numbers: float, offset: float) -> Pair:
    pair = Pair()
    pair.values, pair.offset = wp.array(numbers, dtype=wp.float32, device="cpu"), offset
    return pair


@pytest.fixture
def recorded() -> tuple[wp.Launch, wp.array]:
    """A launch over [1, 2] whose result is 2 x + 1."""
    initialise()
    out = wp.zeros(2, dtype=wp.float32, device="cpu")
    inputs = [pair_of(1.0, 2.0, offset=1.0), 2.0, out]
    return wp.launch(add_offset, 2, inputs, device="cpu", record_cmd=True), out


def test_transforms_are_seen_and_else_assumed(monkeypatch: pytest.MonkeyPatch) -> None:
    one, inside = torch.ones(2), []

    def look(tensor: torch.Tensor) -> torch.Tensor:
        inside.append(transforms())
        return tensor

    torch.func.vmap(look)(torch.eye(2))
    assert inside == [True]
    assert not transforms(one, None)
    for name in ("peek_interpreter_stack", "is_legacy_batchedtensor"):
        with monkeypatch.context() as patch:
            patch.delattr(torch._C._functorch, name)
            assert transforms(one)


def test_a_packed_launch_does_what_the_launch_does(recorded: tuple[wp.Launch, wp.array]) -> None:
    command, out = recorded
    found = packed_launch(command)
    assert found is not None
    launch, packed = found
    launch()
    np.testing.assert_array_equal(out.numpy(), [3.0, 5.0])
    packed.argument_1 = 10.0
    launch()
    np.testing.assert_array_equal(out.numpy(), [11.0, 21.0])


@pytest.mark.parametrize("missing", [None, "hooks", "params"])
def test_a_prepared_launch_runs_with_and_without_packing(
    recorded: tuple[wp.Launch, wp.array], missing: str | None
) -> None:
    command, out = recorded
    if missing is not None:  # as in a version of Warp that has it no longer, which must itself still launch
        kept = {name: value for name, value in vars(command).items() if name != missing}
        hidden = SimpleNamespace(**kept, launch=command.launch, set_param_at_index=command.set_param_at_index)
        assert packed_launch(hidden) is None
        prepared = Prepared(hidden)
    else:
        prepared = Prepared(command)
    prepared()
    np.testing.assert_array_equal(out.numpy(), [3.0, 5.0])
