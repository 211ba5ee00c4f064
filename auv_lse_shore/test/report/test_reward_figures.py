"""The pictures of reward and risk over steps."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from auv_lse_shore.judge.evaluation import Evaluation
from auv_lse_shore.report.reward_figures import map_risk


@pytest.mark.parametrize(("end", "mowing_risk"), [(4.1, 3.5), (0.2, 0.4)])
def test_legend_of_risk_over_steps_covers_no_line(end: float, mowing_risk: float) -> None:
    """High risks of a short mission of many vehicles, and low ones of a usual mission."""
    risk = np.linspace(5.0, end, 21)
    curves = SimpleNamespace(risk=risk, expected_risk=np.full(21, end + 0.1), mowing_risk=mowing_risk)
    summary = SimpleNamespace(mowing_risk=mowing_risk)
    figure = map_risk(cast(Evaluation, SimpleNamespace(curves=curves, summary=summary)))
    assert figure is not None
    FigureCanvasAgg(figure).draw()
    axis = figure.axes[0]
    legend = axis.get_legend()
    assert legend is not None
    box = legend.get_window_extent()
    for line in axis.lines[:2]:
        locations = axis.transData.transform(np.column_stack([line.get_xdata(), line.get_ydata()]))
        assert not any(box.contains(*location) for location in locations)
