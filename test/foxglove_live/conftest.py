"""A simulated cell with the scene and the server for Foxglove, and an operator who leads it."""

import re

import pytest
from shown_cell import ShownCell

from stepdiag_ros import topics


class ServedCell(ShownCell):
    """The cell, what shows it, and the state of its run."""

    def __init__(self, folder):
        shown = [("scene", {}), ("foxglove_server", {"port": 0})]
        super().__init__(folder, [topics.RUN_STATE], shown)

    def last_words(self):
        return self.log("foxglove_server")[-3000:]

    @property
    def port(self):
        log = self.log("foxglove_server")
        return int(re.search(r"viewers connect to ws://127\.0\.0\.1:(\d+)", log).group(1))


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    with ServedCell(tmp_path_factory.mktemp("cell")) as made:
        yield made
