from glob import glob

from setuptools import find_packages, setup

package = "auv_lse_common"

setup(
    name=package,
    version="0.1.0",
    packages=find_packages(exclude=["test", "test.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
        (f"share/{package}/launch", glob("launch/*.launch.py")),
    ],
    zip_safe=True,
    extras_require={"test": ["pytest"]},  # tells `colcon test` to use pytest
    maintainer="AUV LSE developers",
    maintainer_email="maintainers@auv-lse.org",
    description="Strict parameters, frames and random streams shared by the AUV level-set estimation stack",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["vehicle = auv_lse_common.commands.vehicle:main"],
    },
)
