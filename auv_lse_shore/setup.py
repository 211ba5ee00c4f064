from setuptools import find_packages, setup

package = "auv_lse_shore"

setup(
    name=package,
    version="0.1.0",
    packages=find_packages(exclude=["test", "test.*"]),
    package_data={
        f"{package}.live.viewers": ["page_files/*"],
        **{f"{package}.{room}": ["templates/*"] for room in ("adjust", "campaign", "export", "report", "reproduce")},
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=True,
    extras_require={"test": ["pytest"]},  # tells `colcon test` to use pytest
    maintainer="AUV LSE developers",
    maintainer_email="maintainers@auv-lse.org",
    description="Mission command, checks, live view, replay, reports, exports and campaigns",
    license="Apache-2.0",
)
