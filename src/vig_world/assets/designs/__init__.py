"""Procedural teapot designs in dense correspondence."""
