"""ArduPilot's logs: what pymavlink prints about damaged ones."""

from __future__ import annotations

import os

import pytest

from auv_lse_mavlink.flight_logs import _captured_output


def test_complaints_of_pymavlink_are_kept_and_not_printed(capfd: pytest.CaptureFixture[str]) -> None:
    with _captured_output() as complaints:
        print("bad msg at offset 78242")  # its Python part
        os.write(2, b"bad header 0x00\n")  # its C part
        complaints.seek(0)
        kept = complaints.readlines()
    assert len(kept) == 2
    assert capfd.readouterr() == ("", "")
