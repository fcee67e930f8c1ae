"""The ament_python package."""

from setuptools import setup

NAME = "ambinav_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", ["config/ambinav.yaml"]),
        (f"share/{NAME}/launch", ["launch/ambinav.launch.py"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="The ambinav authors",
    maintainer_email="ambinav@example.org",
    description="Ambiguity maps in ROS 2",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"ambinav = {NAME}.node:main"]},
)
