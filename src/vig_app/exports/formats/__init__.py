"""Formats of explanations, a file each.

NAME.py, whose underscores are hyphens in the format's name, has

    FILES                               all files that it may make, or patterns of them, within a folder

and either, for one photo or many of a run,

    write_photos(folder, photos, class_ids)    makes them of `AnnotatedPhoto` and numbers of classes

or

    write(folder, explanation)          makes them
    RUN_FILES, write_run(folder, run)   where the format has files for a run: their names, and what makes them
                                        of an `ExportedRun`

and, where people edit such files, `is_edited(path)`: whether they did. Importing it must need no package of
an extra. With the file alone `vig fit --export NAME` and `Explanation.export` take the format; its files go
when another result is saved into the folder; with `write_photos` or `write_run` so does
`vig export RESULTS --to NAME`.
"""
