"""What is too deep, too long, too much or of another kind is refused in one sentence."""

import struct
from dataclasses import replace

import pytest
from changes import SCHEMAS
from forging import taken_apart
from refused import refused
from small_run import write_small_run

from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.folder import open_bag
from stepdiag_ros.bags.recover import recover
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.configuration import chain_from_text
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.text import intake
from stepdiag_ros.text.sentence import LONGEST, sentence

DEEP = 2**16
LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]\n" for a, b in zip("abcdef", "bcdefg", strict=True)
)


@pytest.mark.parametrize(
    "text",
    [
        "[" * DEEP,
        "{a: " * 1000 + "1" + "}" * 1000,
        "".join(f"{' ' * n}a:\n" for n in range(1000)),
        LAUGHS,
        "a: &a [*a]",
        "a: &a {b: *a}",
        "- 1\n" * 2 * intake.MOST_VALUES,
        "x" * (intake.LONGEST_TEXT + 1),
        "a: " + "9" * 5000,
        "a: 2026-99-99",
        "!!python/object/apply:os.system [exit]",
    ],
    ids=[
        "brackets",
        "braces",
        "lines",
        "laughs",
        "itself",
        "table",
        "very many",
        "long",
        "int",
        "date",
        "tag",
    ],
)
def test_a_yaml_text_beyond_a_limit_is_refused_with_its_source(text):
    with refused(Refusal, where="the plan") as caught:
        intake.parse_yaml(text, "the plan")
    assert len(sentence(caught.value)) <= LONGEST + 2


def test_a_yaml_text_within_the_limits_is_taken_as_before():
    assert intake.parse_yaml("a: &a [1, 2]\nb: *a\n", "x") == {"a": [1, 2], "b": [1, 2]}
    deep = "[" * (intake.DEEPEST - 1) + "]" * (intake.DEEPEST - 1)
    assert intake.parse_yaml(deep, "x") is not None
    assert intake.parse_yaml("", "x") is None


@pytest.mark.parametrize("text", ["[" * DEEP, '{"a":' * DEEP + "1" + "}" * DEEP, "{", "nonsense"])
def test_a_json_text_that_is_none_or_too_deep_is_refused(text):
    with refused(Refusal, where="the map"):
        intake.parse_json(text, "the map")
    assert intake.parse_json('{"[[[[": "{{{{\\"[["}', "x") == {"[[[[": '{{{{"[['}


@pytest.mark.parametrize("chain", ["5", "{a: 1}", "[1, 2, 3]", "[[X], [Y]]"])
def test_a_chain_that_is_no_text_is_refused(chain):
    with refused(Refusal, "malformed", "chain", "m.yaml"):
        chain_from_text(f"chain: {chain}\n", "m.yaml")
    assert chain_from_text("chain: [Y, X, Z]\n", "m.yaml") == "YXZ"


def test_a_sentence_shows_no_control_characters_and_no_pages():
    said = sentence(ValueError("\x1b[2J is \u202e no plan " + "x" * 300_000))
    assert said.isprintable()
    assert len(said) <= LONGEST + 2


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write_small_run(tmp_path_factory.mktemp("whole") / "run.mcap")


@pytest.fixture
def refusal_of(whole, tmp_path):
    """Return the sentence by which a changed bag is refused; it must name the file."""

    def ask(change):
        bag = taken_apart(whole)
        change(bag)
        path = tmp_path / "odd.mcap"
        path.write_bytes(bag.encoded())
        with refused(BagError, None, "odd.mcap") as error:
            run = load_run(path)
            list(run.readings())
        return path, str(error.value)

    return ask


@pytest.mark.parametrize("length", [2**63 - 1, 2**63, 2**64 - 1])
def test_a_length_beyond_the_file_is_refused_wherever_it_stands(refusal_of, length):
    def in_chunk(bag):
        chunk = bag._chunk(bag.chunks[2]).body
        head = chunk[:32] + chunk[32 : 32 + 4 + 4]
        forged = head + struct.pack("<Q", length) + chunk[len(head) + 8 :]
        bag.front.append(type(bag.front[0])(6, forged))

    for change in (
        in_chunk,
        lambda bag: setattr(bag.lies, "record", (3, length)),
        lambda bag: setattr(bag.lies, "inner", (1, length)),
        lambda bag: bag.lies.head.update(uncompressed_size=length),
    ):
        path, _ = refusal_of(change)
        target = path.with_name("rest.mcap")
        report = recover(path, target)
        assert report.losses
        target.unlink()


def test_a_chunk_that_expands_beyond_all_measure_is_refused_before_it_is_there(refusal_of):
    import zstandard

    zeros = zstandard.ZstdCompressor().compress(bytes(2 * intake.LARGEST_CHUNK))
    refusal_of(
        lambda bag: bag.lies.head.update(data=zeros, uncompressed_size=2 * intake.LARGEST_CHUNK)
    )


@pytest.mark.parametrize("text", SCHEMAS, ids=range(len(SCHEMAS)))
def test_a_definition_that_is_none_or_contains_itself_is_refused(refusal_of, text):
    def change(bag):
        number = bag.channels[bag.channel_of("/run/description")].schema_id
        bag.schemas[number] = replace(bag.schemas[number], data=text.encode())

    refusal_of(change)


@pytest.mark.parametrize("field", ["run_id", "plan", "schema_version"])
def test_a_definition_that_lacks_a_field_names_it(refusal_of, field):
    def change(bag):
        number = bag.channels[bag.channel_of("/run/description")].schema_id
        lines = bag.schemas[number].data.decode().split("\n")
        kept = [line for line in lines if f" {field} " not in line]
        assert len(kept) < len(lines)
        bag.schemas[number] = replace(bag.schemas[number], data="\n".join(kept).encode())

    assert f"'{field}'" in refusal_of(change)[1]


def test_a_topic_of_another_type_is_refused_with_both_types(refusal_of):
    def change(bag):
        wrong = bag.channels[bag.channel_of("/diagnostics")].schema_id
        number = bag.channel_of("/run/description")
        bag.channels[number] = replace(bag.channels[number], schema_id=wrong)

    said = refusal_of(change)[1]
    assert "RunDescription" in said
    assert "DiagnosticArray" in said


def test_a_foreign_topic_may_have_any_definition(whole, tmp_path):
    bag = taken_apart(whole)
    number = max(bag.schemas) + 1
    schema = replace(next(iter(bag.schemas.values())), id=number, name="a/msg/B", data=b"x ][")
    bag.schemas[number] = replace(schema, encoding="ros2idl")
    path = tmp_path / "foreign.mcap"
    path.write_bytes(bag.encoded())
    with open_bag(path) as opened:
        assert opened.topics
    assert load_run(path).lines
