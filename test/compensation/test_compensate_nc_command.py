"""``stepdiag compensate-nc``, from a map on the disk to a program on the disk."""

import json
import re

import pytest
from nc_examples import MILLING, machine

from stepdiag_ros import schemas
from stepdiag_ros.cli import main
from stepdiag_ros.compensation.generic import content
from stepdiag_ros.compensation.identified import Identified, Origin

OFFSETS = ["--offset", "G54=150,-150,-300", "--tool-length", "1=20"]


@pytest.fixture
def files(tmp_path):
    identified = Identified(machine(), {}, Origin(file="run.mcap", run_id="test (1)"), ("told",))
    document = schemas.document("volumetric_map", content(identified))
    (tmp_path / "map.json").write_text(schemas.json_text(document), encoding="utf-8")
    (tmp_path / "part.nc").write_bytes(MILLING.replace("first cut", "größter Schnitt").encode())
    return tmp_path


def test_a_program_is_written_and_its_remaining_error_said(files, capsys):
    arguments = ["compensate-nc", str(files / "part.nc"), str(files / "map.json"), *OFFSETS]
    assert main([*arguments, "--json", "--tolerance", "1"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["before"]["largest"] > 20e-6 > 1e-6 >= document["after"]["largest"]
    assert document["uncorrected"][1] == {"line": 18, "reason": "G28 goes to a reference point"}
    assert document["origin"]["run_id"] == "test (1)" and "told" in document["remarks"]
    assert document["map_standard_uncertainty"] is None
    written = (files / "part_corrected.nc").read_bytes()
    assert document["written"] == str(files / "part_corrected.nc")
    assert "(größter Schnitt)".encode() in written
    assert b"(run: test [1])" in written and b"run.mcap" in written
    # Once written it is not written again.
    assert main(arguments) == 1
    assert "exists already" in capsys.readouterr().err
    assert main([*arguments, "--output", str(files / "again.nc")]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"feed moves after +\d\.\d{3} +\d\.\d{3} ", shown)
    assert "note: targets are corrected by the mean of both directions" in shown


def test_what_is_refused_leaves_nothing(files, capsys):
    (files / "bad.nc").write_text("G54 G0 X0 Y0 Z30\nG41 D1 X5\n")
    arguments = ["compensate-nc", str(files / "bad.nc"), str(files / "map.json"), *OFFSETS]
    assert main(arguments) == 1
    warning, error = capsys.readouterr().err.strip().splitlines()
    assert "NOT DIAGNOSED" in warning, "the map does not say what a diagnosis says"
    assert "bad.nc, line 2: G41 cannot be corrected" in error
    assert {path.name for path in files.iterdir()} == {"bad.nc", "map.json", "part.nc"}


def test_a_map_of_another_run_than_the_named_one_is_refused(files, capsys):
    arguments = ["compensate-nc", str(files / "part.nc"), str(files / "map.json"), *OFFSETS]
    assert main([*arguments, "--run", "foo"]) == 1
    assert "'foo'" in capsys.readouterr().err and not (files / "part_corrected.nc").exists()
    assert main([*arguments, "--run", "test (1)"]) == 0


@pytest.mark.parametrize(
    ("option", "name"),
    [(["--offset", "g54=1,0,0"], "G54"), (["--tool-length", "H1=20"], "1")],
)
def test_a_name_with_two_values_is_refused(option, name, files, capsys):
    arguments = ["compensate-nc", str(files / "part.nc"), str(files / "map.json"), *OFFSETS]
    assert main([*arguments, *option]) == 1
    assert f"{option[0]}: '{name}'" in capsys.readouterr().err
    assert not (files / "part_corrected.nc").exists()


@pytest.mark.parametrize("text", ["G21 G54\nM30\n", "(nothing)\n"])
def test_a_program_without_a_move_is_refused(text, files, capsys):
    still = files / "still.nc"
    still.write_text(text)
    assert main(["compensate-nc", str(still), str(files / "map.json"), *OFFSETS]) == 1
    assert "still.nc" in capsys.readouterr().err and not (files / "still_corrected.nc").exists()


@pytest.mark.parametrize(
    ("option", "said"),
    [
        (["--offset", "G54"], "is not G54=X,Y,Z"),
        (["--offset", "G54=1,2"], "is not three numbers"),
        (["--tool-length", "x=2"], "is not H=LENGTH"),
        (["--tolerance", "0"], "is not between"),
    ],
)
def test_wrong_usage(option, said, files, capsys):
    with pytest.raises(SystemExit):
        main(["compensate-nc", str(files / "part.nc"), str(files / "map.json"), *option])
    assert said in capsys.readouterr().err
