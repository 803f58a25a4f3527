"""How much there is to read before the first result is understood."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_ten_minutes_of_reading_lead_to_the_worst_error():
    """From the README to the end of page 2: at most 2,000 words, at 200 a minute."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert "docs/tutorial/2_read.md" in readme or "docs/tutorial/index.md" in readme
    tutorial = [
        ROOT / "docs" / "tutorial" / f"{name}.md" for name in ("index", "1_measure", "2_read")
    ]
    pages = [readme, *(page.read_text(encoding="utf-8") for page in tutorial)]
    assert sum(len(text.split()) for text in pages) <= 2000


def test_the_sidebar_of_the_site_is_seen_at_a_glance():
    home = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    trees = re.findall(r"^```\{toctree\}\n(.*?)^```", home, re.DOTALL | re.MULTILINE)
    entries = [line for tree in trees for line in tree.splitlines() if line and line[0] != ":"]
    assert 8 <= len(entries) <= 12
