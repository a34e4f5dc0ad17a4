"""Procedural indoor environment maps, and the light that a panorama gives.

A room is drawn as boxes and light sources (`rooms`); rays from the viewpoint find the surfaces, each lit by
the sources that it sees and by the light of all the room (`painting`).
"""
