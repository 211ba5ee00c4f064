import os
import sys
from glob import glob
from pathlib import Path
from tempfile import TemporaryDirectory

from setuptools import find_packages, setup

package, version = "auv_lse_run", "0.2.0"
checkout = Path(__file__).resolve().parent.parent
#: pip makes a library, with its dependencies.
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
    package_data={package: ["py.typed", "shipped/*/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
        (f"share/{package}/launch", glob("launch/*.launch.py")),
        *([] if is_library else [("bin", ["bin/auv_lse"])]),  # colcon puts it on PATH; pip makes its own
    ],
    zip_safe=False,
    options={"build": {"build_base": build.name}, "egg_info": {"egg_base": build.name}} if is_library else {},
    python_requires=">=3.11",
    install_requires=[
        "pyyaml",
        "rich",
        sibling("auv_lse_common"),
        sibling("auv_lse_record"),
    ]
    if is_library
    else [],
    extras_require={"test": ["pytest"]},  # tells `colcon test` to use pytest
    maintainer="AUV LSE developers",
    maintainer_email="maintainers@auv-lse.org",
    description="The command auv_lse, processes, ROS domains, dives, and what shows running nodes",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["auv_lse = auv_lse_run.__main__:main"],
        "auv_lse.verbs": ["auv_lse_run = auv_lse_run.verbs:VERBS"],
    },
)
