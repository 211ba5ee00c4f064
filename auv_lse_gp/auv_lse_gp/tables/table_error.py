"""The error of a table or grid that cannot be read."""


class TableError(ValueError):
    """An unusable table or grid of numbers; names the file, the line or array, what is wrong, and the cure."""
