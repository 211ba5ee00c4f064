from setuptools import find_packages, setup

package = "auv_lse_planner"

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
    description="Augmented receding horizon planning with Monte Carlo tree search for a team of AUVs; planner_node",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "planner_node = auv_lse_planner.planner_node:main",
            "safety_node = auv_lse_planner.safety_node:main",
        ],
    },
)
