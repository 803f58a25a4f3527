"""The integration guide names every topic with the type and quality of service that it has."""

import re
from pathlib import Path

import pytest

from stepdiag_ros.metrology.discrepancy import findings
from stepdiag_ros.run.conclusion import UNKNOWN
from stepdiag_ros.topics import TOPICS, Qos

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "integration.md").read_text(encoding="utf-8")
WORDS = {
    Qos.STREAM: "stream",
    Qos.COMMAND: "command",
    Qos.EVENTS: "events",
    Qos.LATCHED: "latched",
    Qos.RESULTS: "latched",
    Qos.HISTORY: "latched",
}


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_a_topic_is_listed_as_it_is(topic):
    quality = f"{WORDS[topic.qos]}, depth {topic.depth}"
    assert f"| `{topic.name}` | `{topic.type_name}` | {quality} |" in PAGE


def test_no_topic_is_listed_that_there_is_not():
    listed = re.findall(r"^\| `(/?[a-z_/]+)` \| `\w+/msg/\w+` \|", PAGE, re.MULTILINE)
    assert sorted(listed) == sorted(topic.name for topic in TOPICS)


def test_every_launch_file_is_listed_with_its_arguments():
    for path in (ROOT / "launch").glob("*.launch.py"):
        arguments = re.findall(
            r'^    "(\w+)": (?:Argument\(|NAMESPACE|ARCHIVE)', path.read_text(), re.M
        )
        row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{path.name}` |"))
        assert re.findall(r"`(\w+)`", row.rsplit("|", 2)[1]) == arguments, path.name


def test_every_verdict_of_a_result_is_listed():
    verdicts = (
        *(findings.CONSISTENT, findings.NAMED, findings.AMBIGUOUS),
        *(findings.DESCRIBED, findings.UNEXPLAINED, findings.NOT_TESTABLE, UNKNOWN),
    )
    (paragraph,) = re.findall(r"\[verdicts\].*?\n\n", PAGE, re.DOTALL)
    assert re.findall(r"\b[A-Z]{3}[A-Z ]+\b(?<! )", paragraph) == list(verdicts)


@pytest.mark.parametrize(
    "page", [*sorted(ROOT.glob("docs/*.md")), ROOT / "README.md"], ids=lambda page: page.name
)
def test_links_between_the_pages_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), f"{page.name} links to {target}, which is not there"
