"""Readers of mesh files, each format's pitfalls in a file of its own."""
