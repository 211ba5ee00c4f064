"""Maximum marginal likelihood: derivatives, known truths, honesty about what the data cannot tell, the command."""

import math

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.stats import multivariate_normal
from verb_main import verb_main

from auv_lse_common.mission_file.parameter_file import parameters_for, read_parameter_file
from auv_lse_common.mission_file.parameters import section
from auv_lse_common.mission_file.sections.gp import KERNELS
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_gp import GpConfig, Kernel
from auv_lse_gp.covariance import likelihood
from auv_lse_gp.covariance.likelihood import MarginalLikelihood, fit
from auv_lse_shore.fit import recorded_soundings

main = verb_main("fit")

SCATTERED = np.random.default_rng(0).uniform(0, 300, (40, 2))


def drawn(config, n=250, size=500.0, seed=0):
    """Soundings of a lake drawn from the prior of `config`."""
    rng = np.random.default_rng(seed)
    positions = rng.uniform(0, size, (n, 2))
    covariance = Kernel(config)(positions, positions) + config.noise_std_m**2 * np.eye(n)
    mean = config.mean_depth_m + positions @ [config.mean_slope_north, config.mean_slope_east]
    return positions, mean + np.linalg.cholesky(covariance) @ rng.normal(size=n)


@pytest.mark.parametrize("two_axes", [False, True])
@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("block", [60, 25])
def test_gradients(name, two_axes, block, monkeypatch):
    monkeypatch.setattr(likelihood, "BLOCK", block)
    positions, depths = drawn(GpConfig(), n=60)
    target = MarginalLikelihood(positions, depths, name, "plane", two_axes)
    x = np.array([4.4, 3.9, 0.7, -4.0]) if two_axes else np.array([4.3, -4.0])
    assert target(x)[1] == pytest.approx(approx_fprime(x, lambda v: target(v)[0], 1e-6), rel=1e-4, abs=1e-4)
    signal, _ = target.best_signal(x)
    y = np.concatenate([[math.log(signal)], x[:-1], [math.log(signal) + x[-1] / 2]])
    # At the best signal the full gradient is the search's: none along the signal; g is noise^2 / signal^2.
    full = target.full_gradient(y)
    assert full[1:-1] == pytest.approx(-target(x)[1][:-1], rel=1e-8, abs=1e-8)
    assert full[-1] == pytest.approx(-2.0 * target(x)[1][-1], rel=1e-8, abs=1e-8)
    assert full[0] + full[-1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("name", KERNELS)
def test_the_value_is_the_likelihood(name):
    config = GpConfig(kernel=name, length_scale_m=70.0, length_scale_2_m=40.0, rotation_deg=35.0, signal_std_m=5.0)
    positions, depths = drawn(config, n=50)
    target = MarginalLikelihood(positions, depths, name, two_axes=True, mean_depth_m=15.0)
    x = np.array([math.log(70.0), math.log(40.0), math.radians(35.0), math.log(0.09 / 25.0)])
    signal, _ = target.best_signal(x)
    covariance = Kernel(config)(positions, positions) / 25.0 + 0.09 / 25.0 * np.eye(50)
    wanted = multivariate_normal(np.full(50, 15.0), signal**2 * covariance).logpdf(depths)
    assert -target(x)[0] == pytest.approx(wanted, rel=1e-10)


def test_blocks_are_neighbours_and_count_as_independent(monkeypatch):
    positions, depths = drawn(GpConfig(), n=50, size=100.0)
    away = positions + np.array([1e5, 0.0])
    x = np.array([math.log(40.0), math.log(1e-3)])
    monkeypatch.setattr(likelihood, "BLOCK", 60)
    shuffled = np.random.default_rng(1).permutation(100)
    both = np.concatenate([positions, away])[shuffled], np.concatenate([depths, depths])[shuffled]
    one = MarginalLikelihood(positions, depths, "matern52", mean_depth_m=15.0)(x)[0]
    two = MarginalLikelihood(*both, "matern52", mean_depth_m=15.0)(x)[0]
    assert two == pytest.approx(2.0 * one, rel=1e-9)


@pytest.mark.parametrize("name", ["matern52", "wendland_c2"])
def test_finds_what_the_data_were_drawn_from(name):
    truth = GpConfig(kernel=name, signal_std_m=4.0, length_scale_m=60.0, noise_std_m=0.4, mean_depth_m=18.0)
    for seed in range(3):
        result = fit(*drawn(truth, seed=seed), kernel=name, restarts=2)
        for field in ("signal_std_m", "length_scale_m", "noise_std_m"):
            error = math.log(getattr(result.config, field) / getattr(truth, field)) / result.standard_errors[field]
            assert abs(error) < 3.5
        assert abs(result.config.mean_depth_m - 18.0) < 3.5 * result.standard_errors["mean_depth_m"]
        assert result.warnings == []
        assert max(result.restarts) == result.log_likelihood


def test_finds_two_axes_and_a_plane():
    truth = GpConfig(signal_std_m=3.0, length_scale_m=120.0, length_scale_2_m=30.0, rotation_deg=40.0, mean="plane",
                     mean_slope_north=0.03, mean_slope_east=-0.02)  # fmt: skip
    positions, depths = drawn(truth, n=300)
    result = fit(positions, depths, mean="plane", two_axes=True, restarts=3)
    config = result.config
    if config.length_scale_m < config.length_scale_2_m:  # which axis is called the first is arbitrary
        lengths, rotation = (config.length_scale_2_m, config.length_scale_m), config.rotation_deg + 90.0
    else:
        lengths, rotation = (config.length_scale_m, config.length_scale_2_m), config.rotation_deg
    assert lengths == pytest.approx((120.0, 30.0), rel=0.4)
    assert math.remainder(rotation - 40.0, 180.0) == pytest.approx(0.0, abs=8.0)
    for name in ("mean_slope_north", "mean_slope_east"):
        assert abs(getattr(config, name) - getattr(truth, name)) < 3.5 * result.standard_errors[name]
    single = fit(positions, depths, mean="plane", restarts=2)
    assert result.log_likelihood > single.log_likelihood + 10.0


def test_warns_of_what_the_data_do_not_determine():
    rng = np.random.default_rng(0)
    positions = rng.uniform(0, 100, (40, 2))
    nothing = fit(positions, 15.0 + rng.normal(0, 1.0, 40))
    assert any("length_scale_m" in warning for warning in nothing.warnings)
    trend = fit(positions, 15.0 + positions[:, 0] / 10.0 + rng.normal(0, 0.1, 40), kernel="squared_exponential")
    assert any("try --mean plane" in warning for warning in trend.warnings)
    same = fit(*drawn(GpConfig(signal_std_m=3.0, length_scale_m=50.0), n=200), two_axes=True, restarts=2)
    assert any("one length scale is enough" in w or w.startswith("rotation_deg") for w in same.warnings)


@pytest.mark.parametrize(
    ("positions", "depths", "options", "message"),
    [
        (np.zeros((5, 2)), np.zeros(5), {}, "soundings: 5 are too few to fit; give at least 10"),
        (np.zeros((20, 2)), np.arange(20.0), {}, "all are at one location"),
        (np.arange(40.0).reshape(20, 2), np.ones(20), {}, r"all have the depth 1\.0 m"),
        (SCATTERED, 3.0 + SCATTERED @ [0.1, -0.02], {"mean": "plane"}, "all depths lie on one plane"),
        (np.zeros((20, 2)), np.zeros(20), {"mean": "survey"}, "use constant or plane"),
        (np.zeros((20, 2)), np.zeros(20), {"mean": "plane", "mean_depth_m": 1.0}, "needs a constant mean"),
    ],
)
def test_refusals(positions, depths, options, message):
    with pytest.raises(ValueError, match=message):
        fit(positions, depths, **options)


def write_csv(path, positions, depths):
    rows = "".join(f"{n:.3f},{e:.3f},{d:.3f}\n" for (n, e), d in zip(positions, depths, strict=True))
    path.write_text("north_m,east_m,depth_m\n" + rows)


def test_command_writes_a_parameter_file_for_a_mission(tmp_path, capsys):
    source, out = tmp_path / "lake.csv", tmp_path / "gp.yaml"
    write_csv(source, *drawn(GpConfig(signal_std_m=5.0, length_scale_m=60.0), n=220))
    assert main([str(source), "--points", "150", "--restarts", "2", "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "using 150 of 220 soundings" in text
    assert "length_scale_m" in text
    parameters = parameters_for(read_parameter_file(out), "/auv1/gp_node")
    config = section(GpConfig, parameters, "gp", str(out))
    assert config.length_scale_m == pytest.approx(60.0, rel=0.4)  # of 150 soundings: 5 standard errors
    assert "220" not in out.read_text()
    assert main([str(source), "--points", "80", "--restarts", "1", "--kernel", "best", "--mean", "plane"]) == 0
    assert "wendland_c2" in capsys.readouterr().out


def test_a_boat_at_its_pier_does_not_decide_the_noise(tmp_path, capsys):
    """A third of the soundings is from one place, before and after the launch."""
    rng, source = np.random.default_rng(4), tmp_path / "lake.csv"
    truth = GpConfig(signal_std_m=2.0, length_scale_m=60.0, noise_std_m=0.1, mean_depth_m=10.0)
    positions, depths = drawn(truth, n=400, seed=1)
    pier = positions[0] + rng.normal(0.0, 0.3, (200, 2))
    rests = depths[0] - 3.0 * (np.arange(200) < 60) + rng.normal(0.0, 0.1, 200)
    write_csv(source, np.vstack([pier, positions]), np.concatenate([rests, depths]))
    assert main([str(source), "--restarts", "2", "--out", str(tmp_path / "gp.yaml")]) == 0
    assert "of those at the same place one counts" in capsys.readouterr().out
    found = section(GpConfig, parameters_for(read_parameter_file(tmp_path / "gp.yaml"), "/auv1/gp_node"), "gp", "")
    assert found.length_scale_m == pytest.approx(60.0, rel=0.3)
    assert found.noise_std_m < 0.4  # with all soundings 0.9, and 83 m


def test_command_takes_lat_and_lon_and_says_where_the_origin_is(tmp_path, capsys):
    source, out = tmp_path / "lake.csv", tmp_path / "gp.yaml"
    positions, depths = drawn(GpConfig(signal_std_m=5.0, length_scale_m=60.0), n=100)
    lat, lon = geodetic_from_local(positions[:, 0], positions[:, 1], 37.2, -80.4)
    rows = "".join(f"{a:.8f};{b:.8f};{d:.3f}\n" for a, b, d in zip(lat, lon, depths, strict=True))
    source.write_text("# lake\nlat;lon;depth_m\n" + rows)
    assert main([str(source), "--restarts", "1", "--mean", "plane", "--out", str(out)]) == 0
    middle = f"{(lat.min() + lat.max()) / 2:.6f}, {(lon.min() + lon.max()) / 2:.6f} deg"
    words = f"of their middle, {middle}; the plane holds for a mission with that area.origin"
    assert words in capsys.readouterr().out
    assert words in out.read_text()
    config = section(GpConfig, parameters_for(read_parameter_file(out), "/auv1/gp_node"), "gp", str(out))
    assert config.length_scale_m == pytest.approx(60.0, rel=0.5)  # of 100 soundings: 5 standard errors


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["absent.csv"], "absent.csv"),
        (["empty.npz"], "error: empty.npz is damaged or not npz"),
        (["."], "is not a recording: neither it nor its folder bag"),
        (["few.csv"], "error: few.csv: soundings: 3 are too few to fit; give at least 10"),
        (["x.csv", "--level", "nan"], "error: --level must be a depth in metres, not nan"),
        (["x.csv", "--out", "no/where/gp.yaml"], "there is no folder no/where"),
        (["line.csv", "--level", "1e9"], "error: --level: 1e+09 m is too far from the prior mean"),
    ],
)
def test_command_errors(tmp_path, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty.npz").touch()
    write_csv(tmp_path / "few.csv", np.arange(6.0).reshape(3, 2), np.arange(3.0))
    rng = np.random.default_rng(1)
    write_csv(tmp_path / "line.csv", rng.uniform(0.0, 200.0, (20, 2)), rng.normal(15.0, 2.0, 20))
    assert main(arguments) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["x.csv", "--points", "3"], "--points: '3' is not a whole number of at least 10"),
        (["x.csv", "--kernel", "cubic"], "invalid choice: 'cubic'"),
        ([], "SOUNDINGS|RUN"),
    ],
)
def test_command_usage(capsys, arguments, message):
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
    assert message in capsys.readouterr().err


def test_a_level_that_the_fitted_prior_nearly_excludes_gets_a_wider_one(tmp_path, capsys):
    """The lake of mean 4.2 and standard deviation 4.4 m, searched for its 15 m isobath."""
    positions, depths = drawn(GpConfig(signal_std_m=4.4, mean_depth_m=4.2, length_scale_m=60.0), n=120)
    table = tmp_path / "survey.csv"
    rows = (f"{north},{east},{depth}" for (north, east), depth in zip(positions, depths, strict=True))
    table.write_text("\n".join(["north_m,east_m,depth_m", *rows]))
    fitted = {}
    for level in (5.0, 25.0):
        assert main([str(table), "--restarts", "1", "--level", f"{level}", "--out", str(tmp_path / "gp.yaml")]) == 0
        fitted[level] = section(
            GpConfig, parameters_for(read_parameter_file(tmp_path / "gp.yaml"), "/x"), "gp", "gp.yaml"
        )
    assert "nearly excludes the 25 m isobath" in capsys.readouterr().out
    assert fitted[5.0].signal_std_m < 6.0
    assert abs(25.0 - fitted[25.0].mean_depth_m) >= 2.0 * (fitted[25.0].signal_std_m - 0.1)
    assert abs(25.0 - fitted[25.0].mean_depth_m) <= 2.0 * fitted[25.0].signal_std_m
    assert "Proposed: " in (tmp_path / "gp.yaml").read_text()


def test_reads_a_recorded_run(tmp_path):
    from rosbags import rosbag2 as writer_module
    from rosbags import typesys

    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    definition = "std_msgs/Header header\nfloat64 north_m\nfloat64 east_m\nfloat64 depth_m\n"
    store.register(typesys.get_types_from_msg(definition, "auv_lse_msgs/msg/Sounding"))
    types = store.types
    header = types["std_msgs/msg/Header"](stamp=types["builtin_interfaces/msg/Time"](sec=1, nanosec=0), frame_id="map")
    run = tmp_path / "run"
    run.mkdir()
    with writer_module.Writer(run / "bag", version=9, storage_plugin=writer_module.StoragePlugin.MCAP) as writer:
        for vehicle in (1, 2):
            topic = writer.add_connection(f"/auv{vehicle}/sounding", "auv_lse_msgs/msg/Sounding", typestore=store)
            for i in range(3):
                message = types["auv_lse_msgs/msg/Sounding"](
                    header=header, north_m=float(i), east_m=10.0 * vehicle, depth_m=5.0 + i
                )
                writer.write(topic, 10 * i + vehicle, store.serialize_cdr(message, "auv_lse_msgs/msg/Sounding"))
    rows = recorded_soundings(run)
    assert sorted(map(tuple, rows.tolist())) == [(i, 10.0 * v, 5.0 + i) for i in (0.0, 1.0, 2.0) for v in (1, 2)]
    assert np.array_equal(recorded_soundings(run / "bag"), rows)
    (run / "bag" / "metadata.yaml").write_text("nonsense: [")
    with pytest.raises(ValueError, match="cannot be read as a rosbag2 recording"):
        recorded_soundings(run)


def test_reaches_the_best_of_scikit_learn():
    positions, depths = drawn(GpConfig(signal_std_m=5.0, length_scale_m=60.0), n=200, seed=4)
    result = fit(positions, depths, mean_depth_m=float(depths.mean()), restarts=2)
    # scikit-learn 1.9.1, best of five starts: constant * Matern 5/2 + white
    assert result.log_likelihood == pytest.approx(-361.48280766, abs=1e-3)  # where its optimizer stops


def test_an_unreadable_file_is_named(tmp_path, capsys):
    assert main([str(tmp_path / "nothing.csv")]) == 2
    assert f"{tmp_path / 'nothing.csv'}: No such file or directory" in capsys.readouterr().err


def test_a_plane_that_is_far_from_the_origin_asks_for_a_constant_mean() -> None:
    rng = np.random.default_rng(3)
    locations_m = rng.uniform(0.0, 200.0, (60, 2))
    depths_m = 0.5 * locations_m[:, 0] + rng.normal(0.0, 0.1, 60)
    assert fit(locations_m, depths_m, mean="plane", restarts=1).config.mean_slope_north == pytest.approx(0.5, abs=0.02)
    with pytest.raises(ValueError, match=r"GpConfig\.mean_depth_m must be .* the origin too far .* constant mean"):
        fit(locations_m + 60_000.0, depths_m, mean="plane", restarts=1)
