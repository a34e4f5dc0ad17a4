"""Procedural designs of mugs and cups in dense correspondence."""
