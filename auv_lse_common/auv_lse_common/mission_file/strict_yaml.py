"""Strict YAML: refuses text that YAML 1.1 would silently read as something else.

A recording's mission file may be of a version that was less strict: its numbers are read as that version read them.
"""

import math
import re
from typing import Any

import yaml

from auv_lse_common.mission_file.parameters import NUMBER_AS_TEXT, ParameterError
from auv_lse_common.support.input_bounds import MAX_YAML_VALUES
from auv_lse_common.support.user_error import brief

#: Beginnings of PyYAML's messages on common mistakes, and messages with the cure.
_CURES = {
    "but found another document": "a second document begins; join both, without the line '---'",
    "expected '<document start>'": "a second document begins; join both, without the line '...'",
    r"found character '\t'": "a tab indents the line; write blanks",
}


def yaml_value(text: str) -> Any:
    """The value of a text in YAML, as for a parameter on the command line.

    Raises:
        ParameterError: if it is not YAML.
    """
    return parse_yaml(text, repr(text))


class _StrictLoader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML comes without types
    """Rejects duplicate keys, of which PyYAML would silently keep only the last one.

    Also rejects aliases that multiply a short file into more than `MAX_YAML_VALUES` values, and numbers that YAML 1.1
    reads in base 8 (010 is 8) or 60 (1:30 is 90).
    """

    def get_single_node(self) -> yaml.Node | None:
        node: yaml.Node | None = super().get_single_node()
        if node is not None and (number := _count_values(node, {})) > MAX_YAML_VALUES:
            what = f"too many values: {number:.3g}, aliases included; at most {MAX_YAML_VALUES} are read"
            raise yaml.constructor.ConstructorError(problem=what, problem_mark=node.start_mark)
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[tuple[str, str]] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and (key.tag, key.value) in seen:
                what = f"the key {key.value!r} appears twice; remove one"
                raise yaml.constructor.ConstructorError(problem=what, problem_mark=key.start_mark)
            seen.add((key.tag, str(key.value)))
        found: dict[Any, Any] = super().construct_mapping(node, deep)
        return found

    def construct_number(self, node: yaml.ScalarNode) -> int | float:
        """Whole numbers and others."""
        text = node.value.lstrip("+-")
        if ":" in text or re.fullmatch(r"0[0-7_]*[1-7][0-7_]*", text):
            base, cure = (60, "in one unit") if ":" in text else (8, "without the zero in front")
            what = f"YAML reads {node.value} in base {base}; write the number {cure}, or a text in quotes"
            raise yaml.constructor.ConstructorError(problem=what, problem_mark=node.start_mark)
        is_whole = node.tag.endswith(":int")
        value: int | float = self.construct_yaml_int(node) if is_whole else self.construct_yaml_float(node)
        return value

    def construct_text(self, node: yaml.ScalarNode) -> str | float:
        """Texts; those without quotes that YAML 1.2, and so ROS, reads as numbers are numbers."""
        text: str = self.construct_yaml_str(node)
        return float(text) if node.style is None and NUMBER_AS_TEXT.fullmatch(text) else text


for _kind in ("int", "float"):
    _StrictLoader.add_constructor(f"tag:yaml.org,2002:{_kind}", _StrictLoader.construct_number)
_StrictLoader.add_constructor("tag:yaml.org,2002:str", _StrictLoader.construct_text)


class _RecordedLoader(_StrictLoader):
    """As the strict one, with YAML 1.1's numbers: those that a vehicle used."""


for _kind in ("int", "float", "str"):
    _RecordedLoader.add_constructor(f"tag:yaml.org,2002:{_kind}", getattr(yaml.SafeLoader, f"construct_yaml_{_kind}"))


def _count_values(node: yaml.Node, known: dict[int, float]) -> float:
    """Values below a node, each alias counted as what it stands for; inf where it stands for itself."""
    if id(node) not in known:
        known[id(node)] = math.inf  # until it is counted: met again meanwhile, it contains itself
        parts = node.value if isinstance(node, yaml.CollectionNode) else ()
        parts = [part for pair in parts for part in pair] if isinstance(node, yaml.MappingNode) else parts
        known[id(node)] = 1.0 + sum(_count_values(part, known) for part in parts)
    return known[id(node)]


def parse_yaml(text: str, where: str, is_recorded: bool = False) -> Any:
    """The content of a text in YAML; `where` names it in messages.

    Args:
        is_recorded: Whether it was used already, so that numbers count as YAML 1.1 reads them.

    Raises:
        ParameterError: if it is not YAML, or could be misread.
    """
    try:
        return yaml.load(text, _RecordedLoader if is_recorded else _StrictLoader)
    except yaml.MarkedYAMLError as error:
        at = error.problem_mark or error.context_mark
        position = f"line {at.line + 1}, column {at.column + 1}: " if at else ""
        problem = str(error.problem or error.context)
        problem = next((cure for begin, cure in _CURES.items() if problem.startswith(begin)), problem)
        raise ParameterError(f"{where}: not valid YAML: {position}{problem}") from error
    except yaml.YAMLError as error:
        raise ParameterError(f"{where}: not valid YAML: {brief(error)}") from error
    except RecursionError as error:
        raise ParameterError(f"{where}: not valid YAML: nested too deeply") from error
    except (ValueError, IndexError) as error:  # an impossible date or number
        raise ParameterError(f"{where}: not valid YAML: {error}") from error
