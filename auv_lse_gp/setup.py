from setuptools import find_packages, setup

package = "auv_lse_gp"

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
    description="Bayes-risk level-set estimation on an online Gaussian process; gp_node",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["gp_node = auv_lse_gp.gp_node:main"],
    },
)
