"""A seal tells whether a recording is the one that was signed, and by which key."""

import base64
import json
import shutil
import stat

import pytest
from forging import taken_apart
from refused import refused
from small_run import write_small_run

from stepdiag_ros import schemas
from stepdiag_ros.bags.seal import new_key, read_seal, require_seal, seal, seal_path
from stepdiag_ros.cli import main
from stepdiag_ros.metrology.refusal import Refusal


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write_small_run(tmp_path_factory.mktemp("whole") / "run.mcap")


@pytest.fixture
def bag(whole, tmp_path):
    return shutil.copy(whole, tmp_path / "run.mcap")


@pytest.fixture
def key(tmp_path):
    path = tmp_path / "cell.key"
    new_key(path)
    return path


def public(key):
    return key.with_name(f"{key.name}.pub")


def test_a_private_key_is_for_its_owner_alone_and_never_overwritten(key):
    assert stat.S_IMODE(key.stat().st_mode) == 0o600
    assert b"PRIVATE" not in public(key).read_bytes()
    with refused(Refusal, "exists", "cell.key"):
        new_key(key)


def test_a_sealed_bag_is_known_again_under_any_name(bag, key, tmp_path, validators):
    assert read_seal(bag) is None
    written = seal(bag, key, "A. Dent")
    document = json.loads(written.read_text())
    assert validators[schemas.identifier("seal")].is_valid(document)
    found = require_seal(bag, public(key))
    assert (found.right, found.words, found.key) == (True, "A. Dent", document["public_key"])
    moved = tmp_path / "other.mcap"
    bag.rename(moved)
    seal_path(bag).rename(seal_path(moved))
    assert require_seal(moved, public(key)).right
    with refused(Refusal, "exists", "other.mcap.sig"):
        seal(moved, key)


def test_a_bag_that_was_changed_with_all_checksums_right_is_found(bag, key):
    seal(bag, key)
    changed = taken_apart(bag)
    changed.chunks.pop()
    bag.write_bytes(changed.encoded())
    assert not read_seal(bag).right
    with refused(Refusal, "mismatch", "run.mcap", aspect="content"):
        require_seal(bag, public(key))


@pytest.mark.parametrize(
    "field", ["sha256", "size", "sealed_at", "words", "public_key", "signature"]
)
def test_no_field_of_a_seal_can_be_changed(bag, key, field):
    path = seal(bag, key, "mine")
    document = json.loads(path.read_text())
    value = document[field]
    if field == "size":
        document[field] = value + 1
    elif field in ("public_key", "signature"):
        raw = bytearray(base64.b64decode(value))
        raw[5] ^= 1
        document[field] = base64.b64encode(bytes(raw)).decode()
    else:
        document[field] = "0" + value[1:] if value[0] != "0" else "1" + value[1:]
    path.write_text(json.dumps(document))
    assert not read_seal(bag).right


@pytest.mark.parametrize(
    "text", ["", "nonsense", "[]", "{}", "[" * 70_000, "x" * 200_000, '{"schema": 5}', "\0"]
)
def test_what_is_no_seal_is_wrong_and_said(bag, text, capsys):
    seal_path(bag).write_text(text)
    found = read_seal(bag)
    assert not found.right
    assert found.problem
    assert main(["info", str(bag)]) == 1
    assert "seal" in capsys.readouterr().err


def test_another_key_is_not_the_one_that_is_trusted(bag, key, tmp_path):
    other = tmp_path / "other.key"
    new_key(other)
    seal(bag, other)
    assert read_seal(bag).right
    with refused(Refusal, "mismatch", "run.mcap", aspect="key"):
        require_seal(bag, public(key))
    for wrong in (key, bag):
        with refused(Refusal, "wrong_kind", aspect="public key"):
            require_seal(bag, wrong)
    with refused(Refusal, "wrong_kind", "cell.key.pub", aspect="private key"):
        seal(tmp_path / "cell.key.pub", public(key))


def test_commands_make_and_check_seals(bag, tmp_path, capsys):
    key = tmp_path / "my.key"
    tables = ["compensate", str(bag), "--for", "generic", "--pictures", "none"]
    assert main(["seal", "--new-key", str(key)]) == 0
    required = ["--require-seal", str(public(key)), "--output", str(tmp_path / "tables")]
    assert main([*tables, *required]) == 1
    assert "has no seal" in capsys.readouterr().err
    assert not (tmp_path / "tables").exists()
    assert main(["seal", str(bag)]) == 1
    assert main(["seal", str(bag), "--key", str(key), "--words", "mine"]) == 0
    capsys.readouterr()
    assert main(["seal", str(bag), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert main(["info", str(bag), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["seal"]["public_key"] == told["public_key"]
    assert main(["report", str(bag), "--json", "--output", str(tmp_path / "page")]) == 0
    document = json.loads((tmp_path / "page" / "report.json").read_text())
    assert document["sections"]["measurement"]["seal"]["right"] is True
    assert main([*tables, *required]) == 0
    bag.write_bytes(taken_apart(bag).encoded())
    capsys.readouterr()
    assert main(["info", str(bag)]) == 1
    assert "is wrong" in capsys.readouterr().err
