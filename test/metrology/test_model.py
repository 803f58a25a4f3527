"""The model file: what it may say, the way there and back, and what is refused."""

import copy

import pytest
import yaml
from refused import a_fault, refused

from stepdiag_ros.configuration import available, find, load_model, model_from_text
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.model import FITTED, FIXED, MachineModel, ModelEffect, Provenance
from stepdiag_ros.metrology.refusal import Refusal

FULL = {
    "name": "a mill",
    "chain": "YXZ",
    "curves": {"E_XX": [0.0, 1e-7, 3e-7]},
    "effects": [
        {
            "effect": "backlash",
            "setting": {"axis": "X"},
            "sizes": {"lost_motion": 8e-7},
            "standard_uncertainty": {"lost_motion": 2e-8},
            "status": "fitted",
            "provenance": {
                "bag": "run.mcap",
                "sha256": "0123456789abcdef" * 4,
                "date": "2026-01-31",
                "evidence": "it was seen",
            },
        }
    ],
}


def model_of(mapping):
    return model_from_text(yaml.safe_dump(mapping), "mill.yaml")


def test_a_whole_model_is_read_and_written_back():
    model = model_of(FULL)
    assert (model.name, model.chain) == ("a mill", "YXZ")
    assert model.curves == {"E_XX": (0.0, 1e-7, 3e-7)}
    (effect,) = model.effects
    assert effect.label == "backlash of X"
    assert effect.active.sizes == {"lost_motion": 8e-7}
    assert effect.standard_uncertainty == {"lost_motion": 2e-8}
    assert effect.provenance == Provenance(
        "run.mcap", "0123456789abcdef" * 4, "2026-01-31", "it was seen"
    )
    assert model.of_status(FITTED) == (effect.active,)
    assert model.of_status(FIXED) == ()
    assert model.to_mapping() == FULL
    assert model_of(model.to_mapping()) == model


def test_the_digests_of_several_runs_are_read():
    several = copy.deepcopy(FULL)
    provenance = several["effects"][0]["provenance"]
    provenance.update(bag="a.mcap + b.mcap", sha256=" + ".join(("0" * 64, "f" * 64)))
    assert model_of(several).to_mapping() == several


def test_little_need_be_said():
    model = model_of({"curves": "free"})
    assert model == MachineModel()
    assert model_of(model.to_mapping()) == model
    short = copy.deepcopy(FULL)
    for key in ("standard_uncertainty", "status", "provenance"):
        del short["effects"][0][key]
    (effect,) = model_of(short).effects
    assert effect.status == FIXED and effect.provenance == Provenance()
    # What is not told is not known, and says so when it is written.
    written = model_of(short).to_mapping()["effects"][0]
    assert written["standard_uncertainty"] == {"lost_motion": "unknown"}


@pytest.mark.parametrize("status", [FIXED, FITTED])
def test_a_model_holds_a_typical_size_of_rotations_which_is_not_negative(status):
    """A cell may not (``test_effects_in_cell``): the size does not say which way an axis turns."""
    turns = {"effect": "several angular errors", "sizes": {"size": 12e-6}, "status": status}
    model = model_of({"chain": "YXZ", "effects": [turns]})
    (active,) = model.of_status(status)
    assert active.effect.typical and active.sizes == {"size": 12e-6}
    assert model_of(model.to_mapping()).of_status(status) == (active,)
    with refused(Refusal, "out_of_range", "effects[0]", "-1.2e-05", about="size"):
        model_of({"chain": "YXZ", "effects": [{**turns, "sizes": {"size": -12e-6}}]})


def test_a_date_without_quotes_is_a_date():
    text = yaml.safe_dump(FULL).replace("'2026-01-31'", "2026-01-31")
    assert "2026-01-31\n" in text
    assert model_from_text(text, "mill.yaml").effects[0].provenance.date == "2026-01-31"


def _changed(change):
    mapping = copy.deepcopy(FULL)
    change(mapping, mapping["effects"][0])
    return mapping


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m, _: m.update(chain="XYX"), a_fault("unknown", "XYX", "mill.yaml", about="chain")),
        (lambda m, _: m.update(cruves="free"), a_fault("unknown", "curves", about="cruves")),
        (
            lambda m, _: m.update(curves=[1.0]),
            a_fault("malformed", "curves", "free", "[1.0]", aspect="curves"),
        ),
        (lambda m, _: m.update(curves={"E_AX": [0.0, 1.0]}), a_fault("unknown", "E_AX")),
        (
            lambda m, _: m.update(curves={"E_XX": [0.0]}),
            a_fault("malformed", "E_XX", aspect="values"),
        ),
        (
            lambda m, _: m.update(effects={"effect": "backlash"}),
            a_fault("malformed", about="effects"),
        ),
        (
            lambda _, e: e.update(effect="backslash"),
            a_fault("unknown", "backslash", "effects[0]", about="effect"),
        ),
        (lambda _, e: e.update(setting={"axis": "W"}), a_fault("unknown", "W", about="axis")),
        (lambda _, e: e.update(sizes={"lost": 1.0}), a_fault("unknown", about="lost")),
        (lambda _, e: e.update(status="free"), a_fault("unknown", "free", about="status")),
        (
            lambda _, e: e["standard_uncertainty"].update(lost_motion=-1.0),
            a_fault("out_of_range", "-1", about="lost_motion"),
        ),
        (lambda _, e: e["provenance"].update(sha256="abc"), a_fault("malformed", "64")),
        (lambda m, e: m["effects"].append(copy.deepcopy(e)), a_fault("twice", "X")),
    ],
)
def test_what_is_wrong_is_refused_with_its_place(change, words):
    with refused(Refusal, words):
        model_of(_changed(change))


def test_an_effect_that_is_there_is_replaced_and_another_is_added():
    model = model_of(FULL)
    effect = catalogue()["backlash"]

    def of(axis, size):
        active = ActiveEffect(effect, {"axis": axis}, {"lost_motion": size})
        return ModelEffect(active, {"lost_motion": 1e-8})

    grown = model.with_effects([of("X", 5e-7), of("Z", 1e-7)])
    assert [one.label for one in grown.effects] == ["backlash of X", "backlash of Z"]
    assert grown.effects[0].active.sizes == {"lost_motion": 5e-7}
    assert model.effects[0].active.sizes == {"lost_motion": 8e-7}


def test_every_model_of_the_package_can_be_read():
    assert {"free", "demo"} <= set(available("models"))
    for name in available("models"):
        assert load_model(name)[1]
    free = load_model("free")[0]
    assert free.effects == () and free.curves == {} and free.chain == ""
    text = find("free", "models").read_text()
    for key in ("chain", "curves", "effects", "standard_uncertainty", "status", "provenance"):
        assert f"{key}:" in text
