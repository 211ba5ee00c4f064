"""Largest accepted sizes of inputs: larger ones would take minutes or all memory to read.

Readers check the size of an input before they process it.
"""

import errno
import stat
from pathlib import Path

#: Bytes of a mission, campaign or other YAML file.
MAX_YAML_BYTES = 2_000_000
#: Values of a YAML file, each alias counted as all that it stands for.
MAX_YAML_VALUES = 200_000
#: Node patterns of a mission file.
MAX_PATTERNS = 2_000
#: Corners of the operating area and its no-go areas together.
MAX_CORNERS = 2_000
#: Nodes of the raster of distances to the area's border.
MAX_RASTER_NODES = 20_000_000
#: Cells of a map.
MAX_CELLS = 1_000_000
#: Soundings of a table.
MAX_SOUNDINGS = 500_000
#: Nodes of a grid of depths, as read from a file and as made from soundings.
MAX_GRID_NODES = 25_000_000
#: Bytes of a table or of a grid as text.
MAX_TEXT_BYTES = 500_000_000


def over_size(path: Path, most_bytes: int) -> str:
    """The error for a file that is too large ("FILE is too large: 2,100 MB, at most 500 MB are read"), else "".

    Raises:
        OSError: if it cannot be read, or is a device, which may never end.
    """
    status = path.stat()
    if stat.S_ISCHR(status.st_mode) or stat.S_ISBLK(status.st_mode):
        raise OSError(errno.EINVAL, "it is a device; name a file", str(path))
    size = status.st_size
    return (
        f"{path} is too large: {size / 1e6:,.0f} MB, at most {most_bytes / 1e6:,.0f} MB are read"
        if size > most_bytes
        else ""
    )
