"""An ament_python package: colcon reads nothing else."""

from glob import glob

from setuptools import setup

NAME = "contactwrench_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
        (f"share/{NAME}/config", glob("config/*.yaml")),
    ],
    install_requires=["setuptools", "contactwrench"],
    zip_safe=True,
    maintainer="contactwrench",
    maintainer_email="contactwrench@users.noreply.example",
    description="From a raw wrist force/torque sensor to the pure contact wrench: a node around contactwrench.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["contactwrench = contactwrench_ros.node:main"]},
)
