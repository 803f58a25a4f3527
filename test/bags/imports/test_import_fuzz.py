"""Arbitrary bytes: refused in one sentence or taken whole, never a traceback or half a bag."""

from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import example, given, settings
from hypothesis import strategies as st
from import_files import DATA, RTL

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.imports.imported import ImportOptions
from stepdiag_ros.bags.imports.registry import import_file
from stepdiag_ros.bags.run import load_run

_EXAMPLES = {
    "made_up_axis.rtl": "",
    "made_up_runs_in_columns.csv": "runs_in_columns",
    "made_up_rows.csv": "rows_of_positions",
    "made_up_step_diagonal.txt": "step_diagonal_stops",
}
_SIGNS = st.sampled_from(
    [
        b"\n",
        b"\r",
        b";",
        b",",
        b".",
        b'"',
        b" ",
        b"\t",
        b"-",
        b"1e99",
        b"\xff",
        b"\0",
        b"::",
        b":",
        b"nan",
        b"0",
        b"7",
        b"HEADER::\n",
        b"1\t1\t1\n",
        "µ".encode(),
        "٣".encode(),
        b"\x85",
        b"",
    ]
)


def check(data, name, mapping):
    with TemporaryDirectory() as folder:
        path, bag = Path(folder) / name, Path(folder) / "made.mcap"
        path.write_bytes(data)
        try:
            import_file(path, bag, ImportOptions(axis="X", mapping=mapping))
        except TableError as error:
            assert str(error)
            assert "\n" not in str(error)
            assert [found.name for found in Path(folder).iterdir()] == [name]
        else:
            assert load_run(bag).lines


@settings(max_examples=60)
@given(data=st.binary(max_size=300), name=st.sampled_from(sorted(_EXAMPLES)))
def test_any_bytes(data, name):
    check(data, name, _EXAMPLES[name])
    check(b"HEADER::\n" + data, RTL.name, "")


@settings(max_examples=60)
@given(
    name=st.sampled_from(sorted(_EXAMPLES)),
    edits=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 30), _SIGNS), min_size=1, max_size=3),
)
@example(name="made_up_rows.csv", edits=[(0.0, 0, b'"'), (1.0, 0, b'"')])
def test_an_example_with_some_bytes_changed(name, edits):
    data = (DATA / name).read_bytes()
    for place, length, sign in edits:
        at = int(place * len(data))
        data = data[:at] + sign + data[at + length :]
    check(data, name, _EXAMPLES[name])
