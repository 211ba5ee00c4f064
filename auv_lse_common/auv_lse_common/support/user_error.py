"""Errors as one line of text for the terminal."""

from pathlib import Path

#: Letters of another library's error that are shown.
_MOST = 200


def error_text(error: BaseException) -> str:
    """An error as one line. An OSError becomes "FILE: No such file or directory", without "[Errno 2]"."""
    if isinstance(error, OSError) and error.strerror:
        if isinstance(error, FileExistsError) and error.filename is not None and Path(error.filename).is_file():
            return f"{error.filename} is a file, not a folder; choose another name"
        files = [str(name) for name in (error.filename, error.filename2) if name is not None]
        return ": ".join([*files, error.strerror])
    return str(error) or type(error).__name__


def brief(error: BaseException) -> str:
    """Another library's error for a sentence of ours: one line, and not all of the bytes that some quote."""
    text = " ".join(error_text(error).split()).rstrip(".")
    return text if len(text) <= _MOST else f"{text[:_MOST]} ..."
