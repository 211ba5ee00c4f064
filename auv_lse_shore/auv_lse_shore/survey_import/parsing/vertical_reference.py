"""The vertical reference that crowdsourced bathymetry, or a table, states for its depths."""

import json
import re
import shlex

from auv_lse_shore.survey_import.log_content import LogContent, Reference

_STATED = re.compile(r'"verticalReferenceOfDepth"\s*:\s*"(\w+)"')
#: A step of processing that reduced the depths to a datum, and the datum.
_REDUCTION = re.compile(r'\{[^{}]*"VerticalReduction"[^{}]*\}')
_DATUM = re.compile(r'"datum"\s*:\s*("(?:[^"\\]|\\["\\/bfnrt]|\\u[0-9a-fA-F]{4})+")')


def reduced_to(datum: str) -> str:
    """A note on depths below a datum."""
    name = " ".join(datum.split())
    return f"depths are reduced to {name}: auv_lse export --datum {shlex.quote(name)} keeps it"


def vertical_reference(about: str, content: LogContent) -> Reference:
    """The reference of the depths; `content` gets a question about an unknown one, and a note on a datum.

    Args:
        about: The file's text without its features.
    """
    stated, reduction = _STATED.search(about), _REDUCTION.search(about)
    if reduction and (datum := _DATUM.search(reduction[0])):
        content.notes.append(reduced_to(json.loads(datum[1], strict=False)))
    elif reduction:
        content.questions.append("depths are reduced to an unnamed datum: name it with auv_lse export --datum")
    elif stated and stated[1] == "Unknown":
        content.questions.append(
            "the file does not state what its depths are measured from: the surface is assumed; --draught adds a "
            "transducer's depth, and auv_lse export --datum names a datum"
        )
    return Reference.TRANSDUCER if stated and stated[1] == "Transducer" else Reference.SURFACE
