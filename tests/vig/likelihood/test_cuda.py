"""The kernels compile for CUDA, which needs no device; running them there does."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
import warp as wp

from vig.likelihood.kernels.assembly import likelihood_kernels


@pytest.mark.parametrize("name", ["place", "rasterize_faces", "interior", "boundary", "assemble"])
def test_a_module_compiles_for_cuda(name: str, tmp_path: Path) -> None:
    """One kernel of each module; native snippets are C++ that Warp hands on unread."""
    module = getattr(likelihood_kernels(torch.float32, 10), name).module
    if wp.get_cuda_toolkit_version() is None:
        pytest.skip("this build of Warp has no CUDA compiler")
    wp.compile_aot_module(module, arch=90, module_dir=tmp_path, use_ptx=True)
    (code,) = tmp_path.glob("*.ptx")
    assert "_cuda_kernel_forward" in code.read_text()
