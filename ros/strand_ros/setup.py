"""Build the ament package: its node, launch file and marker of the ament index."""

from setuptools import setup

NAME = "strand_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/ropes.launch.py"]),
        (f"share/{NAME}/config", ["config/ropes.yaml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    license="MIT OR Apache-2.0",
    entry_points={"console_scripts": [f"ropes = {NAME}.node:main"]},
)
