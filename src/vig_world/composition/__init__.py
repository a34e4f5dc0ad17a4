"""Composition of scenes: the object's place, occluders, clutter."""
