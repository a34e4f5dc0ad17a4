"""Datasets made, resumed and checked."""
