"""The package alone starts without numba, which takes a second to load."""

import os
import subprocess
import sys

CODE = """
import sys
import auv_lse_gp, auv_lse_gp.map.online, auv_lse_gp.covariance.likelihood
assert "numba" not in sys.modules, "imported before it is used"
auv_lse_gp.expected_bayes_risk(15.0, 1.0, 1.0, 15.0, 10.0, 10.0)
from auv_lse_common.support.compiled import USE_NUMBA
assert ("numba" in sys.modules) is USE_NUMBA
"""


def test_numba_is_imported_on_first_use():
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
