"""The error of a table that cannot be read."""


class TableError(ValueError):
    """A table that cannot be read; names the file, what is wrong with it, and the cure."""
