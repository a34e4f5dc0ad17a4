"""Private interfaces of torch: what they tell today, and what happens when they are gone."""

import pytest
import torch

from vig_renderer.internals import transforms


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
