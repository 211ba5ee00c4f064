from setuptools import find_packages, setup

package = "auv_lse_comms"

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
    description="252-byte packets, TDMA, acoustic modem driver and MAVLink link; modem_node",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "modem_node = auv_lse_comms.modem_node:main",
            "micromodem_node = auv_lse_comms.micromodem.micromodem_node:main",
            "vehicle_link_node = auv_lse_comms.mavlink.vehicle_link_node:main",
        ],
    },
)
