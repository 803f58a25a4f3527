"""The environment in which node processes start."""

import subprocess
import sys

import pytest

import stepdiag_ros
from stepdiag_ros.processes.node_process import environment


@pytest.mark.skipif(sys.version_info < (3, 11), reason="Python 3.10 always looks where it stands")
def test_nodes_are_of_the_package_that_starts_them_also_beside_another_copy(tmp_path, monkeypatch):
    copy = tmp_path / "stepdiag_ros"
    copy.mkdir()
    (copy / "__init__.py").write_text("")
    monkeypatch.chdir(tmp_path)
    told = [sys.executable, "-c", "import stepdiag_ros; print(stepdiag_ros.__file__)"]
    done = subprocess.run(told, env=environment(), capture_output=True, text=True, check=True)
    assert done.stdout.strip() == stepdiag_ros.__file__
