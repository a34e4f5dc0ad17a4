"""Formats of explanations, a file each.

NAME.py has

    FILES                               all files that `write` may make, within the folder of an explanation
    write(folder, explanation, photo)   makes them; `photo` is the photo's name in them

and, where the format has one file for all photos of a run,

    RUN_FILE                            the file's name
    write_run(path, run)                makes it of an `ExportedRun`

Importing it must need no package of an extra. With the file alone `vig fit --export NAME` and
`Explanation.export` take the format, and its files go when another result is saved into the folder; with
`RUN_FILE` so does `vig export RESULTS --to NAME`.
"""
