"""Names of files from identities of runs, which whoever starts a run may choose."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag_ros.run.identity import file_name_of, new_run_id

HARD = [
    *("", ".", "..", "../../x", "/etc/passwd", "a/b", "a\\b", "-rf", "--force", ".bashrc", "CON"),
    *("nul.txt", "com1", "a\0b", "a\nb", "C:x", "x" * 10_000, "é", "\u202e", "a.", "~root"),
    *("$HOME", "\ud800", "_x", "a b", "*"),
]


@pytest.mark.parametrize("run_id", HARD, ids=ascii)
def test_no_identity_leads_out_of_its_folder(run_id, tmp_path):
    name = file_name_of(run_id)
    assert re.fullmatch("[A-Za-z0-9][A-Za-z0-9._-]{0,119}", name) and not name.endswith(".")
    assert name != run_id and name.split(".")[0].upper() not in ("CON", "NUL", "COM1")
    file = tmp_path / f"{name}.mcap"
    file.touch()
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


def test_identities_of_our_own_are_names_already():
    for run_id in (new_run_id(), "20260102T030405-abcd", "run-1", "mill_7.second"):
        assert file_name_of(run_id) == run_id


@given(st.text(), st.text())
def test_different_identities_have_different_names(one, other):
    names = file_name_of(one), file_name_of(other)
    assert (names[0] == names[1]) == (one == other)
    assert all(Path(name).name == name and len(name) < 130 for name in names)
