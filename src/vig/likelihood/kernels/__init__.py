"""Warp kernels of one evaluation of the objective."""
