"""What the years of a machine show, in sentences."""

from types import SimpleNamespace

from stepdiag_ros.words.trends import change_sentences


def _figure(name, *dates):
    changes = [
        SimpleNamespace(
            kind="step", earliest=date - 0.1, latest=date, size=1e-6, expanded=2e-7, e_n=5.0
        )
        for date in dates
    ]
    return SimpleNamespace(name=name, unit="m", trend=SimpleNamespace(changes=changes))


def test_changes_of_all_figures_come_newest_first():
    machine = SimpleNamespace(figures=[_figure("C0Y", 50.0, 54.0), _figure("E_XX", 52.0)])
    said = change_sentences(machine)
    assert [name for sentence in said for name in ("C0Y", "E_XX") if name in sentence] == [
        *("C0Y", "E_XX", "C0Y")
    ]
    assert ["2023" in said[0], "2021" in said[1], "2019" in said[2]] == [True, True, True]
