"""Drawing on two cores: an error in one half waits for the other."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from auv_lse_shore.report import report_figures


def test_an_error_leaves_no_process_that_still_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(e: Any) -> Figure:
        raise ValueError("the first error")

    def takes_long(e: Any) -> Figure | None:
        time.sleep(0.5)
        (tmp_path / "late").touch()
        raise OSError("the second error")

    monkeypatch.setattr(report_figures, "FIGURES", (("a.png", "", fails), ("b.png", "", takes_long)))
    with pytest.raises(ValueError, match="the first error"):
        report_figures.draw_all(None, tmp_path)  # type: ignore[arg-type]
    assert (tmp_path / "late").exists(), "else a removed folder would be written to"
