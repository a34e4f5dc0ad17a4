"""Private interfaces of libraries: what they tell today, and what happens when they are gone."""

import pytest
import torch

from vig_train.network.network import has_bfloat16


def test_bfloat16_is_what_torch_says_and_else_taken_for_absent(monkeypatch: pytest.MonkeyPatch) -> None:
    for answer in (True, False):
        monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda answer=answer: answer)
        assert has_bfloat16() is answer
    monkeypatch.delattr(torch.cpu, "_is_avx512_bf16_supported")
    assert has_bfloat16() is False
