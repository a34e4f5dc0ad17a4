"""Formats of the results of a run, one file for all photos.

NAME.py has

    FILE                the file's name
    write(path, run)    makes it of an `ExportedRun`

With the file alone `vig export RESULTS --to NAME` takes the format, and so does `vig fit --export NAME` where
an explanation has a format of that name.
"""
