import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from setuptools import find_packages, setup

package, version = "auv_lse_shore", "0.2.0"
checkout = Path(__file__).resolve().parent.parent
#: pip makes a library: with its dependencies, and without executables of nodes, which ROS finds elsewhere.
is_library = not {"bdist_wheel", "dist_info", "editable_wheel"}.isdisjoint(sys.argv)
build = TemporaryDirectory()


def sibling(name):
    """The requirement of a package of this stack: of this checkout, if it is in one. No index has these packages."""
    is_beside = (checkout / name / "setup.py").is_file() and "AUV_LSE_WHEELS" not in os.environ
    return f"{name} @ {(checkout / name).as_uri()}" if is_beside else f"{name}=={version}"


setup(
    name=package,
    version=version,
    packages=find_packages(exclude=["test", "test.*"]),
    package_data={
        package: ["py.typed"],
        f"{package}.live.viewers": ["page_files/*"],
        **{
            f"{package}.{room}": ["templates/*"]
            for room in ("adjust", "campaign", "certify", "export", "report", "reproduce")
        },
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=False,
    options={"build": {"build_base": build.name}, "egg_info": {"egg_base": build.name}} if is_library else {},
    python_requires=">=3.11",
    install_requires=[
        "contourpy",
        "dask",
        "distributed",
        "jinja2",
        "matplotlib",
        "numpy>=1.26",
        "pyarrow<26",  # 26 needs NumPy 2, which its metadata do not declare
        "pyproj",
        "pyyaml",
        "rich",
        "scipy>=1.11",
        "shapely",
        "tornado",
        sibling("auv_lse_common"),
        sibling("auv_lse_comms"),
        sibling("auv_lse_gp"),
        sibling("auv_lse_planner"),
        sibling("auv_lse_record"),
        sibling("auv_lse_run"),
        sibling("auv_lse_sim"),
    ]
    if is_library
    else [],
    extras_require={
        "test": ["pytest"],  # tells `colcon test` to use pytest
        "optional": ["h5py", "pyogrio", "rasterio", sibling("auv_lse_mavlink")],
    },
    maintainer="AUV LSE developers",
    maintainer_email="maintainers@auv-lse.org",
    description="Mission command, checks, live view, replay, reports, exports and campaigns",
    license="Apache-2.0",
    entry_points={"auv_lse.verbs": ["auv_lse_shore = auv_lse_shore.verbs:VERBS"]},
)
