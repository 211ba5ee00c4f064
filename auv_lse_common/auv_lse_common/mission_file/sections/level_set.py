"""Section `level_set`: the isobath to find, and the costs of wrong calls."""

from auv_lse_common.mission_file.parameters import configuration, parameter
from auv_lse_common.vocabulary.sounding import DEEPEST_M


@configuration
class LevelSetConfig:
    """The isobath to find, and the costs of wrong calls."""

    level_m: float = parameter(
        15.0, unit="m", low=0.0, high=DEEPEST_M, help="Depth of the isobath, positive downwards (paper: l)"
    )
    cost_false_safe: float = parameter(
        10.0, above=0.0, high=1e6, help="Cost of calling an unsafe location safe (paper: c1)"
    )
    cost_false_unsafe: float = parameter(
        10.0, above=0.0, high=1e6, help="Cost of calling a safe location unsafe (paper: c2)"
    )

    @property
    def largest_risk(self) -> float:
        """The largest Bayes risk that a position can have: c1 c2 / (c1 + c2), where P(f >= l) = c1 / (c1 + c2)."""
        return self.cost_false_safe * self.cost_false_unsafe / (self.cost_false_safe + self.cost_false_unsafe)
