"""A simulated cell with the scene and the server for Foxglove, and an operator who leads it."""

from running_cell import RunningCell, fixture_of

from stepdiag_ros import topics


class ServedCell(RunningCell):
    """The cell, what shows it, and the state of its run."""

    def __init__(self, folder):
        shown = [("scene", {}), ("foxglove_server", {"port": 0})]
        super().__init__(folder, [topics.RUN_STATE], shown)

    @property
    def port(self):
        told = r"viewers connect to ws://127\.0\.0\.1:(\d+)"
        return int(self.logged_once("foxglove_server", told))


cell = fixture_of(ServedCell)
