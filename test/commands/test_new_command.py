"""A command is one module: put into the package, it is there with its help and its place."""

import pytest

from stepdiag_ros import cli, commands

MODULE = """
from stepdiag_ros.commands.arguments import Command, Group, add_common


def _add_options(parser):
    parser.add_argument("count", type=int)
    for name in ("json", "seed", "pictures", "output"):
        add_common(parser, name)


def run(arguments):
    print([arguments.count, arguments.json, arguments.seed, arguments.pictures])
    return 3


COMMAND = Command(
    "count-up",
    Group.MEASURE,
    15,
    _add_options,
    run,
    help="count from one",
    description="Count from one, aloud.",
    epilog="example: stepdiag count-up 5",
)
"""


@pytest.fixture
def added(monkeypatch, tmp_path):
    (tmp_path / "count_up.py").write_text(MODULE)
    monkeypatch.setattr(commands, "__path__", [*commands.__path__, str(tmp_path)])


def _printed(capsys, *arguments):
    try:
        code = cli.main(arguments)
    except SystemExit as ended:
        code = ended.code
    return code, capsys.readouterr()


@pytest.mark.usefixtures("added")
def test_it_stands_in_its_place_in_the_list(capsys):
    _, said = _printed(capsys, "--help")
    assert "count from one" in said.out
    places = [said.out.index(f"\n  {name} ") for name in ("demo", "count-up", "plan")]
    assert places == sorted(places)


@pytest.mark.usefixtures("added")
def test_it_has_its_help_and_the_common_options(capsys):
    code, said = _printed(capsys, "count-up", "--help")
    assert code == 0
    for text in ("Count from one, aloud.", "stepdiag count-up 5", "format of the pictures"):
        assert text in said.out


@pytest.mark.usefixtures("added")
def test_it_runs(capsys):
    code, said = _printed(capsys, "count-up", "--json", "5", "--pictures", "svg")
    assert code == 3
    assert said.out == "[5, True, 0, 'svg']\n"


@pytest.mark.usefixtures("added")
@pytest.mark.parametrize("seed", ["-1", "1.5", "1e9", "99999999999"])
@pytest.mark.parametrize("command", ["count-up 5", "budget x.mcap", "diagnose x.mcap", "demo"])
def test_a_seed_is_a_whole_number_wherever_one_is_given(capsys, command, seed):
    code, said = _printed(capsys, *command.split(), f"--seed={seed}")
    assert code == 2
    assert "--seed" in said.err and seed in said.err


def test_it_is_gone_with_its_module(capsys):
    code, said = _printed(capsys, "count-up", "5")
    assert code == 2
    assert "count-up" in said.err


def test_our_own_are_told_apart():
    own = cli.commands()
    for told in ([one.name for one in own], [one.help for one in own]):
        assert len(set(told)) == len(own)
    assert len({(one.group, one.order) for one in own}) == len(own)
