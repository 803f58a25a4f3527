"""``stepdiag node``: its help, and what it refuses before the node starts."""

import pytest
from refused import refused

from stepdiag_ros import cli
from stepdiag_ros.commands.node import _check_parameter_files
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.parameters.declaration import COMMON, written
from stepdiag_ros.parameters.nodes import NODES


@pytest.fixture
def parameter_file(tmp_path):
    def written(pattern):
        path = tmp_path / "cell.yaml"
        path.write_text(f"{pattern}: {{ros__parameters: {{device: linuxcnc}}}}")
        return str(path)

    return written


def test_a_misspelt_node_in_a_parameter_file_is_refused(parameter_file, capsys):
    path = parameter_file("/**/cnc_bridg")
    given = ["--ros-args", "--params-file", path]
    with refused(Refusal, "unknown", path, "cnc_bridg", "cnc_bridge"):
        _check_parameter_files("bridge", given)
    assert cli.main(["node", "bridge", *given]) == 1
    assert path in capsys.readouterr().err


@pytest.mark.parametrize(
    ("pattern", "renamed"),
    [
        ("/**/solver", []),
        ("/**", []),
        ("/mill", ["-r", "__node:=mill"]),
        ("/cell_1/cnc_bridge", ["-r", "__ns:=/cell_1"]),
    ],
)
def test_a_file_for_the_node_or_for_another_one_of_ours_is_taken(parameter_file, pattern, renamed):
    given = ["--ros-args", *renamed, "--params-file", parameter_file(pattern)]
    _check_parameter_files("bridge", given)
    if renamed:
        with refused(Refusal, "unknown"):
            _check_parameter_files("bridge", ["--ros-args", *given[3:]])


@pytest.mark.parametrize("name", ["bridge", "cnc_bridge"])
def test_a_node_has_two_names(name, monkeypatch, capsys):
    monkeypatch.setattr("stepdiag_ros.nodes.bridge.main", lambda: 7)
    monkeypatch.setattr("sys.argv", [])
    assert cli.main(["node", name]) == 7
    assert cli.main(["parameters", name, "--yaml"]) == 0
    assert "/**/cnc_bridge:" in capsys.readouterr().out


@pytest.mark.parametrize("node", NODES, ids=lambda node: node.name)
def test_the_help_of_a_node_explains_every_parameter_in_80_columns(node, capsys):
    assert cli.main(["node", node.module, "--help"]) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    read = " ".join(out.split())
    assert node.purpose[1:] in read and f"stepdiag node {node.module} --ros-args -p " in read
    for declared in (*node.parameters, *COMMON):
        start = read.index(f" {declared.name} ({declared.type_name}; default ")
        told = read[start : read.index(declared.description[1:], start)]
        for fact in (written(declared.default), declared.unit, declared.limits):
            assert fact in told, declared.name


def test_help_is_printed_wherever_it_is_asked_for_and_starts_nothing(monkeypatch, capsys):
    monkeypatch.setattr("stepdiag_ros.nodes.solver.main", lambda: pytest.fail("was started"))
    for asked in (["-h"], ["--ros-args", "-p", "tolerance:=0.1", "--help"]):
        assert cli.main(["node", "solver", *asked]) == 0
        assert "tolerance" in capsys.readouterr().out
