"""``package.xml``: its version, its addresses and its dependencies stand elsewhere too."""

import re
from importlib import metadata
from pathlib import Path

import pytest
import yaml
from catkin_pkg.changelog import Changelog, populate_changelog_from_rst
from catkin_pkg.package import parse_package
from catkin_pkg.package_version import get_forthcoming_label, rename_section

import stepdiag_ros

ROOT = Path(__file__).parents[2]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
KEYS = {
    "aiohttp": "python3-aiohttp",
    "cryptography": "python3-cryptography",
    "jinja2": "python3-jinja2",
    "matplotlib": "python3-matplotlib",
    "numpy": "python3-numpy",
    "pillow": "python3-pil",
    "pyserial": "python3-serial",
    "pyyaml": "python3-yaml",
    "rich": "python3-rich",
    "scipy": "python3-scipy",
}
"""Distribution → rosdep key, where the key means a package of Ubuntu.

The other distributions have no key in ros/rosdistro, or one that runs pip: with that ``rosdep
install`` fails on Ubuntu 24.04, and no package can be released.
"""
REPLACED_BY_RCLPY = {"cyclonedds"}
"""What only the embedded client needs."""


@pytest.fixture(scope="module")
def manifest():
    """Return ``package.xml``, valid for ROS 2's tools."""
    found = parse_package(ROOT / "package.xml")
    found.validate()
    return found


def test_the_version_is_the_same_everywhere(manifest):
    version = stepdiag_ros.__version__
    assert version == manifest.version == CITATION["version"] == metadata.version("stepdiag_ros")


def test_the_address_is_the_same_everywhere(manifest):
    addresses = {url.type: url.url for url in manifest.urls}
    assert set(addresses) == {"website", "repository", "bugtracker"}
    assert addresses["repository"] == CITATION["repository-code"]
    told = metadata.metadata("stepdiag_ros").get_all("Project-URL")
    assert {one.split(", ")[0].lower(): one.split(", ")[1] for one in told} == addresses


def names(requirements):
    """Return the names that a list of requirements begins with."""
    return {re.match(r"[\w-]+", one).group().lower() for one in requirements}


def test_each_dependency_comes_from_rosdep_or_by_the_pip_command_of_the_page(manifest):
    page = (ROOT / "docs/integration.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"^pip install (.+)$", page, re.MULTILINE)
    required = names(one for one in metadata.requires("stepdiag_ros") if "extra ==" not in one)
    assert required == set(KEYS) | set(command.split()) | REPLACED_BY_RCLPY
    keys = {one.name for one in manifest.exec_depends if one.name.startswith("python3-")}
    assert keys == set(KEYS.values())


def test_the_packages_that_colcon_test_needs_are_dependencies(manifest):
    used = {"ament_cmake_pytest", "python3-pytest"}
    for path in (ROOT / "test/conformance").glob("*.py"):
        imported = r"^\s*from (\w+)\.(?:msg|srv|action) import"
        used |= set(re.findall(imported, path.read_text(), re.MULTILINE))
    needed = {one.name for one in (*manifest.exec_depends, *manifest.test_depends)}
    assert "example_interfaces" in used and used - {"stepdiag_ros"} <= needed


def test_the_changelog_can_be_released():
    """ROS 2's tools give the forthcoming section its version, and read it (REP-132)."""
    text = (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")
    released = rename_section(text, get_forthcoming_label(text), "9.9.9 (2026-01-31)")
    changelog = Changelog("stepdiag_ros")
    populate_changelog_from_rst(changelog, released)
    version, date, content = next(changelog.foreach_version())
    assert (version, f"{date:%Y-%m-%d}") == ("9.9.9", "2026-01-31") and content
