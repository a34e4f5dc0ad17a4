"""Procedural furnished rooms, each a pure function of a random generator."""
