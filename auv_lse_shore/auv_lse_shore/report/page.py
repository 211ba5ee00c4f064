"""Self-contained HTML pages from Jinja templates, and numbers formatted for readers."""

import base64
import math
from pathlib import Path
from typing import Any, NamedTuple

from auv_lse_common.support.missing_packages import missing

try:
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
except ImportError as error:
    raise missing(error, "reports") from error

_HERE = "auv_lse_shore.report"


class Picture(NamedTuple):
    """An image for the macro `figure`: its data URI and its caption."""

    data: str
    caption: str


def embed(image: Path, caption: str) -> Picture:
    """A PNG file as part of a page."""
    return Picture("data:image/png;base64," + base64.b64encode(image.read_bytes()).decode(), caption)


def page_environment(package: str, escaped: bool) -> Environment:
    """Loads templates from the folders `templates` of a package and of the report; undefined values are errors.

    Args:
        package: Its templates can extend and import those of the report: `page.html` and `parts.html`.
        escaped: Whether to escape values for HTML and XML.
    """
    loader = ChoiceLoader([PackageLoader(package), PackageLoader(_HERE)])
    return Environment(
        loader=loader, autoescape=escaped, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )


def render(template: str, package: str = _HERE, **values: Any) -> str:
    """A page from a package's template; values are escaped, except in Markdown.

    Raises:
        jinja2.UndefinedError: if the template uses a value that was not given.
    """
    environment = page_environment(package, escaped=not template.endswith(".md"))
    return environment.get_template(template).render(**values) + "\n"


def number(value: Any, digits: int = 4) -> str:
    """A value for readers: four significant digits, a dash for unknown."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        if abs(value) < 0.5e-6:
            return "0"
        decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
        return f"{value:.{min(decimals, 6)}f}"
    if isinstance(value, list | tuple):
        return ", ".join(number(v, digits) for v in value)
    return str(value)
