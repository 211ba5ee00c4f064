"""What a mission leaves behind."""

import numpy as np
import pytest

from auv_lse_record.run_data import VehicleRun


def test_wrong_columns_are_rejected():
    with pytest.raises(ValueError, match=r"auv3 truth must have the shape \(n, 4\), not \(2, 3\)"):
        VehicleRun(vehicle=3, truth=np.zeros((2, 3)))
