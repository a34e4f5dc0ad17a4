"""Where everything in a scene goes: the object's place, occluders, clutter."""
