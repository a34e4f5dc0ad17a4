"""Formats of an explanation, a file each.

NAME.py has

    FILES                               all files that `write` may make, within the folder
    write(folder, explanation, photo)   makes them; `photo` is what the photo is called in them

Importing it must need no package of an extra. With the file alone `vig fit --export NAME` and
`Explanation.export` take the format, and its files go when another result is saved into the folder.
"""
