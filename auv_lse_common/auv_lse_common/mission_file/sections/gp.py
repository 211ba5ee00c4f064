"""Parameters of the Gaussian process: the section `gp` of a mission file."""

from auv_lse_common.mission_file.parameters import ParameterError, configuration, parameter
from auv_lse_common.vocabulary.sounding import DEEPEST_M

#: Names of the covariance functions, see `kernels.py`.
KERNELS = ("matern52", "squared_exponential", "wendland_c2")

#: Multiple of `publish_period_s` between two maps while only the recorder reads them.
UNWATCHED_PERIODS = 4

#: Prior means, see `prior_mean.py`.
MEANS = ("constant", "plane", "survey")


@configuration
class GpConfig:
    """The prior of the water depth, and how soundings enter it (paper, section "Online GP")."""

    kernel: str = parameter("matern52", choices=KERNELS, help="Covariance function k(p, p')")
    signal_std_m: float = parameter(
        8.0, above=0.0, high=10e3, unit="m", help="Standard deviation of the depth about its mean"
    )
    std_soundings: float = parameter(
        100.0,
        low=0.0,
        high=1e6,
        help="The published map rescales its standard deviation to fit the soundings; signal_std_m counts as this many "
        "soundings in that. 0: no rescaling. Planners always use signal_std_m",
    )
    length_scale_m: float = parameter(
        85.0,
        above=0.0,
        high=100e3,
        unit="m",
        help="Length scale (of the first axis). A Wendland kernel's support is a fixed multiple of it",
    )
    length_scale_2_m: float = parameter(
        0.0, low=0.0, high=100e3, unit="m", help="Length scale of the second axis; 0: the same (isotropic)"
    )
    rotation_deg: float = parameter(
        0.0, low=-180.0, high=180.0, unit="deg", help="Direction of the first axis, clockwise from north"
    )
    noise_std_m: float = parameter(
        0.3, above=0.0, high=1e3, unit="m", help="Standard deviation of a sounding's error (sigma_n)"
    )
    mean: str = parameter("constant", choices=MEANS, help="Prior mean m(p)")
    mean_depth_m: float = parameter(
        15.0, low=-1e3, high=DEEPEST_M, unit="m", help="Constant mean, or the plane's depth at the origin"
    )
    mean_slope_north: float = parameter(0.0, low=-10.0, high=10.0, help="Plane: metres deeper per metre north")
    mean_slope_east: float = parameter(0.0, low=-10.0, high=10.0, help="Plane: metres deeper per metre east")
    survey_file: str = parameter(
        "", help="Survey: CSV of north_m, east_m, depth_m, or an npz grid; linear interpolation, nearest outside"
    )
    min_spacing_m: float = parameter(
        10.0,
        low=0.0,
        high=10e3,
        unit="m",
        help="A sounding becomes a center if it is at least this far from every center",
    )
    merge: bool = parameter(True, help="A sounding too close to a center is averaged into it instead of being dropped")
    team_outlier_sigmas: float = parameter(
        5.0,
        low=0.0,
        high=1e6,
        help="A team mate's sample more than this many sigmas from its prediction is not used; 0: no gate",
    )
    max_centers: int = parameter(
        12000,
        low=1,
        high=100_000,
        help="Maximum number of kernel centers; at most half from samples. Further centers are discarded and reported",
    )
    min_depth_m: float = parameter(
        0.0, low=-1e3, high=DEEPEST_M, unit="m", help="Minimum plausible depth; shallower soundings are rejected"
    )
    max_depth_m: float = parameter(
        1000.0, low=-1e3, high=DEEPEST_M, unit="m", help="Maximum plausible depth; deeper soundings are rejected"
    )
    map_resolution_m: float = parameter(5.0, above=0.0, high=10e3, unit="m", help="Cell size of the map")
    publish_period_s: float = parameter(
        30.0,
        above=0.0,
        high=1e6,
        unit="s",
        help="Node: time between diagnostics, and maps below 50,000 cells; "
        "four times as long between maps that only the recorder reads",
    )

    def __post_init__(self) -> None:
        """Checks combinations.

        Raises:
            ParameterError: naming the contradictory fields.
        """
        if self.mean == "survey" and not self.survey_file:
            raise ParameterError("gp.survey_file is empty; gp.mean 'survey' needs a file of soundings")
        if self.min_depth_m >= self.max_depth_m:
            raise ParameterError(
                f"gp.min_depth_m is {self.min_depth_m!r} m, but must be below gp.max_depth_m ({self.max_depth_m!r} m)"
            )
        if self.noise_std_m < 1e-4 * self.signal_std_m:
            raise ParameterError(
                f"gp.noise_std_m: {self.noise_std_m!r} m is too small for a stable posterior; use at least 1e-4 "
                f"of gp.signal_std_m ({self.signal_std_m!r} m)"
            )
