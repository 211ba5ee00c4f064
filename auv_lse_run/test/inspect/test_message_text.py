"""Messages as text."""

from __future__ import annotations

import array

import numpy as np
import pytest

from auv_lse_run.inspect.message_text import FieldError, csv_text, field_of, plain, yaml_text


class Message:
    """What a generated message has: its fields as attributes, and their names."""

    def __init__(self, **fields: object) -> None:
        self.__dict__.update(fields)

    def get_fields_and_field_types(self) -> dict[str, str]:
        return dict.fromkeys(self.__dict__, "")


STATUS = Message(
    header=Message(frame_id="map"),
    values=[Message(key="a", value=1.5), Message(key="b", value=2.0)],
    payload=array.array("B", range(5)),
    covariance=np.zeros(2),
    on=True,
)


def test_messages_are_printed_as_by_ros2_topic_echo() -> None:
    assert yaml_text(plain(STATUS)) == (
        "header:\n  frame_id: map\nvalues:\n- key: a\n  value: 1.5\n- key: b\n  value: 2.0\n"
        "payload:\n- 0\n- 1\n- 2\n- 3\n- 4\ncovariance:\n- 0.0\n- 0.0\non: true\n".replace("on: true", "'on': true")
    )
    assert csv_text(plain(STATUS)) == "map,a,1.5,b,2.0,0,1,2,3,4,0.0,0.0,True\n"


def test_long_arrays_and_texts_are_cut_or_omitted() -> None:
    assert plain(array.array("d", [1.0, 2.0, 3.0]), truncate=2) == [1.0, 2.0, "..."]
    assert plain("abcdef", truncate=3) == "abc..."
    assert plain(list(range(200)), truncate=None) == list(range(200))
    assert plain(STATUS, arrays=False)["payload"] == "<sequence of 5>"


def test_field_of_a_path() -> None:
    assert field_of(STATUS, "header.frame_id") == "map"
    assert field_of(STATUS, "values[1].key") == field_of(STATUS, "values[-1].key") == "b"
    assert yaml_text(plain(field_of(STATUS, "values[0].value"))) == "1.5\n"


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("header.fram_id", r"header has no 'fram_id'; did you mean 'frame_id'\?"),
        ("xyz", "the message has no 'xyz'; it has header, values, payload, covariance, on"),
        ("values[2].key", r"\[2\] not found; values has 2 elements"),
        ("on[0]", r"\[0\] not found; on has no sequence"),
        ("header.frame_id.x", "header.frame_id has no 'x'; it has no fields"),
    ],
)
def test_missing_field_is_named(path: str, words: str) -> None:
    with pytest.raises(FieldError, match=words):
        field_of(STATUS, path)
