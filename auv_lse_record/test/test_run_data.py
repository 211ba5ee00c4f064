"""What a mission leaves behind."""

import numpy as np
import pytest

from auv_lse_record.run_data import VehicleRun


def test_wrong_columns_are_rejected():
    with pytest.raises(ValueError, match=r"auv3 truth: got shape \(2, 3\); expected \(n, 4\)"):
        VehicleRun(vehicle=3, truth=np.zeros((2, 3)))
