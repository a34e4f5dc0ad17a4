"""Code that runs inside Blender's Python: imports bpy and numpy, nothing of vig; started as a script."""
