import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from setuptools import find_packages, setup

package, version = "auv_lse_record", "0.2.0"
checkout = Path(__file__).resolve().parent.parent
#: pip makes a library: with its dependencies, and without executables of nodes, which ROS finds elsewhere.
is_library = not {"bdist_wheel", "dist_info", "editable_wheel"}.isdisjoint(sys.argv)
build = TemporaryDirectory()
nodes = ["recorder_node = auv_lse_record.recorder_node:main"]


def sibling(name):
    """The requirement of a package of this stack: of this checkout, if it is in one. No index has these packages."""
    is_beside = (checkout / name / "setup.py").is_file() and "AUV_LSE_WHEELS" not in os.environ
    return f"{name} @ {(checkout / name).as_uri()}" if is_beside else f"{name}=={version}"


setup(
    name=package,
    version=version,
    packages=find_packages(exclude=["test", "test.*"]),
    package_data={package: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=False,
    options={"build": {"build_base": build.name}, "egg_info": {"egg_base": build.name}} if is_library else {},
    python_requires=">=3.11",
    install_requires=[
        "mcap",
        "numpy>=1.26",
        "rosbags",
        sibling("auv_lse_common"),
    ]
    if is_library
    else [],
    extras_require={"test": ["pytest"]},  # tells `colcon test` to use pytest
    maintainer="AUV LSE developers",
    maintainer_email="maintainers@auv-lse.org",
    description="Recordings of missions: the recorder node, reading, writing and recovering rosbag2 files",
    license="Apache-2.0",
    entry_points={
        "auv_lse.verbs": ["auv_lse_record = auv_lse_record.verbs:VERBS"],
        "auv_lse.nodes": nodes,  # what auv_lse starts
        "console_scripts": [] if is_library else nodes,  # what `ros2 run` starts
    },
)
