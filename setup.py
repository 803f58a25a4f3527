"""Packaging for machines without ROS 2; colcon uses CMakeLists.txt beside it."""

from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

# msg/, action/ and config/ stay at the root, where ROS 2 wants them, and travel inside the wheel.
SHARED = [
    "msg",
    "action",
    "config",
    "config.plans",
    "config.machines",
    "config.cells",
    "config.instruments",
    "config.trackers",
    "config.models",
    "config.devices",
    "config.linuxcnc",
    "config.imports",
    "config.rviz",
    "config.foxglove",
    "config.plotjuggler",
    "config.security",
    "config.security.common",
]

MANIFEST = ElementTree.parse("package.xml")
DOCS = ["furo>=2024.8", "myst-parser>=4,<6", "sphinx>=8.1,<10"]

setup(
    name="stepdiag_ros",
    version=MANIFEST.findtext("version"),
    description="Laser measurement of machine tools along step diagonals and linear axes on ROS 2",
    long_description=Path("README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license=MANIFEST.findtext("license"),
    maintainer=MANIFEST.findtext("maintainer"),
    maintainer_email=MANIFEST.find("maintainer").get("email"),
    project_urls={url.get("type").capitalize(): url.text for url in MANIFEST.iter("url")},
    python_requires=">=3.10,<3.14",
    packages=[
        *find_packages(include=["stepdiag_ros", "stepdiag_ros.*"]),
        *[f"stepdiag_ros.share.{name}" for name in SHARED],
    ],
    package_dir={f"stepdiag_ros.share.{name}": name.replace(".", "/") for name in SHARED},
    package_data={
        "": [
            "py.typed",
            "*.msg",
            "*.srv",
            "*.action",
            "*.json",
            "*.yaml",
            "*.rviz",
            "*.xml",
            "*.ini",
            "*.hal",
        ],
        "stepdiag_ros.report.pages": ["templates/*", "templates/*/*"],
        "stepdiag_ros.viewers.page": ["static/*"],
        # rclpy's stand-in is no sub-package: it is found under its own name, and only when needed.
        "stepdiag_ros.embedded": [
            "interfaces/*/*/*.msg",
            "interfaces/*/*/*.srv",
            "interfaces/*/*/*.action",
            "modules/rclpy/*.py",
            "modules/rclpy/*/*.py",
        ],
    },
    install_requires=[
        "aiohttp>=3.9,<4",
        "cryptography>=41,<60",
        "cyclonedds>=11.0.1,<11.1",
        "jinja2>=3.1,<4",
        "matplotlib>=3.7,<4",
        "mcap>=1.5,<2",
        "msgspec>=0.21,<1",
        "numpy>=1.26,<3",
        "pillow>=10,<14",
        "pyserial>=3.5,<4",
        "pyyaml>=6.0,<7",
        "rich>=13,<16",
        "rosbags>=0.11,<0.12",
        "scipy>=1.11,<2",
        "threadpoolctl>=3.1,<4",
        "weasyprint>=68,<71",
    ],
    extras_require={
        "test": [
            *DOCS,
            "asyncua>=1.1.5,<3",
            "catkin_pkg>=1,<2",
            "dccXMLJSONConv>=2.3.4,<3",
            "dsiUnits>=3.1,<4",
            "foxglove-sdk>=0.30,<0.31",
            "hypothesis>=6,<7",
            "ipykernel>=6,<8",
            "jsonschema-rs>=0.61,<1",
            "lxml>=5,<7",
            "mcap-ros2-support>=0.5.5,<1",
            "mpmath>=1.3,<2",
            "mypy>=1.11,<3",
            "nbclient>=0.10,<1",
            "nbformat>=5,<6",
            "playwright>=1.40,<2",
            "py_trees>=2.3,<3",
            "pytest>=8,<10",
            "pytest-timeout>=2.3,<3",
            "pytest-xdist>=3.5,<4",
            "ruff>=0.6,<1",
            "setuptools>=68",
            "types-PyYAML",
            "types-pyserial",
        ],
        "docs": DOCS,
        "foxglove": ["foxglove-sdk>=0.30,<0.31"],
        "opcua": ["asyncua>=1.1.5,<3"],
        "parquet": ["pyarrow>=15"],
    },
    entry_points={"console_scripts": ["stepdiag = stepdiag_ros.cli:main"]},
)
