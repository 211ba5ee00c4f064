from setuptools import find_packages, setup

package = "auv_lse_record"

setup(
    name=package,
    version="0.1.0",
    packages=find_packages(exclude=["test", "test.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=True,
    extras_require={"test": ["pytest"]},  # tells `colcon test` to use pytest
    maintainer="AUV LSE developers",
    maintainer_email="maintainers@auv-lse.org",
    description="Recordings of missions: the recorder node, reading, writing and recovering rosbag2 files",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["recorder_node = auv_lse_record.recorder_node:main"],
    },
)
