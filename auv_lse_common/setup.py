import sys
from tempfile import TemporaryDirectory

from setuptools import find_packages, setup

package, version = "auv_lse_common", "0.2.0"
#: pip makes a library: with its dependencies, and without executables of nodes, which ROS finds elsewhere.
is_library = not {"bdist_wheel", "dist_info", "editable_wheel"}.isdisjoint(sys.argv)
build = TemporaryDirectory()

setup(
    name=package,
    version=version,
    packages=find_packages(exclude=["test", "test.*"]),
    package_data={package: ["py.typed", "support/*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=False,
    options={"build": {"build_base": build.name}, "egg_info": {"egg_base": build.name}} if is_library else {},
    python_requires=">=3.11",
    install_requires=[
        "numpy>=1.26",
        "pyproj",
        "pyyaml",
    ]
    if is_library
    else [],
    extras_require={"test": ["pytest"], "optional": ["numba"]},  # tells `colcon test` to use pytest
    maintainer="AUV LSE developers",
    maintainer_email="maintainers@auv-lse.org",
    description="Strict parameters, frames and random streams shared by the AUV level-set estimation stack",
    license="Apache-2.0",
    entry_points={},
)
