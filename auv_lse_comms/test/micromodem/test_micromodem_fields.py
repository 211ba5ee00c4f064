"""Fields of the sentences: times by hand."""

import math

from auv_lse_comms.micromodem.sentences.fields import (
    arrival_time,
    clock_time,
    iso_time,
    read_arrival_time,
    read_iso_time,
)


def test_times_by_hand():
    assert iso_time(1575255779.9) == "2019-12-02T03:02:59Z"
    assert clock_time(1575255779.9) == "030259"
    assert arrival_time(1575255779.12341) == "20191202030259.1234"
    assert arrival_time(1575255779.99999) == "20191202030300.0000"
    assert read_iso_time("2019-12-02T03:02:59Z", "t") == (1575255779.0, 1.0)
    assert read_iso_time("2019-12-02T03:02:59.25Z", "t") == (1575255779.25, 0.01)
    assert math.isnan(read_arrival_time("00000000000000.0000"))
