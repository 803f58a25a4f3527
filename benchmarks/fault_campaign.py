"""Random faults in measuring runs: does the machine stop, is every result right, every bag whole?

Each fault comes at a random moment of a run. Then an operator does what operators do: sees to what
has broken, and resumes when the run is held, until it is finished. The judge is automatic: while
the run is held the machine stands; nobody but the operator resumes; no command is executed twice;
every published line is that of the simulated cell within its noise; every bag opens with all
checksums, or is recovered. Stopped, it goes on where it was when started again with the same
folder and seed. The exit code is 1 if one fault was not borne.

    python benchmarks/fault_campaign.py --folder FOLDER --faults 200 --seed 1
    python benchmarks/fault_campaign.py --folder FOLDER --faults 1 --seed 1 --first 17
    python benchmarks/fault_campaign.py --folder FOLDER --faults 200 --linuxcnc
"""

import argparse
import json
import os
import random
import signal
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import yaml

sys.path.insert(0, str(Path(__file__).parent))

from fault_judging import DeviceLog, doubled, whole, wrong_lines
from faulty_devices import install

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros.processes.cell import PATIENT, simulated_cell, twin_cell
from stepdiag_ros.processes.node_process import NodeProcess, Processes
from stepdiag_ros.run.sequence import State

CELL, MACHINE, PLAN = "demo", "demo", "quick"
NODES = ("clock", "recorder", "assembler", "solver", "weather", "bridge", "interferometer")
ROLES = {"bridge": "cnc_bridge"}
"""Name of a node → its role, where they differ."""
START_LIMIT, STOP_LIMIT, RUN_LIMIT = 60.0, 6.0, 150.0
"""Real seconds for all nodes to come up; from a fault to standstill; from the last to the end."""
HELD_FOR = 0.7
"""Real seconds that a held run is watched before the operator resumes."""

LASER = {
    "drop": (0.05, 1.5, 0.0),
    "freeze": (0.2, 2.0, 0.0),
    "spike": (0.3, 0.3, 2e-5),
    "slip": (0.2, 0.2, 4e-4),
    "beam": (0.02, 1.0, 0.0),
    "stall": (0.2, 3.0, 0.0),
}
CNC = {
    "freeze": (0.2, 2.0, 0.0),
    "offset": (0.5, 2.0, 5e-6),
    "stall": (0.2, 3.0, 0.0),
    "error": (0.1, 1.0, 0.0),
    "estop": (0.1, 0.1, 0.0),
}
"""Fault of a device → shortest and longest duration, s; largest size, m."""
ENCODER = {"encoder": (0.5, 1.5, 0.0)}
"""One that stands still on a controller that is real: a following error."""
KILLED = ("bridge", "interferometer", "assembler", "solver", "recorder", "weather", "sequencer")
HALTED = ("bridge", "interferometer", "assembler", "recorder", "sequencer")


def draw(seed, number, linuxcnc=False):
    """Return the fault of a number: the same for the same seed."""
    chance = random.Random(f"{seed} {number}")
    where = chance.choice(("laser", "cnc", "kill", "halt"))
    fault = {"number": number, "where": where, "after_stops": chance.randint(1, 6)}
    fault["delay"] = round(chance.uniform(0.0, 0.4), 3)
    if where in ("laser", "cnc"):
        table = LASER if where == "laser" else CNC | (ENCODER if linuxcnc else {})
        kind = chance.choice(sorted(table))
        low, high, size = table[kind]
        signed = chance.choice((-1.0, 1.0)) * chance.uniform(0.1, 1.0) * size
        return fault | {
            "kind": kind,
            "duration": round(chance.uniform(low, high), 3),
            "size": signed,
        }
    if where == "kill":
        return fault | {"kind": chance.choice(KILLED), "duration": 0.0, "size": 0.0}
    return fault | {
        "kind": chance.choice(HALTED),
        "duration": round(chance.uniform(0.3, 4.0), 3),
        "size": 0.0,
    }


class Cell:
    """The nodes of a measurement with devices that can be made faulty, and an operator.

    Args:
        folder: for bags, logs and what tells the devices their faults.
        factor: simulated seconds in a real one.
        linuxcnc: an instance of LinuxCNC in place of the simulated controller; None for that.
    """

    def __init__(self, folder, factor, linuxcnc=None):
        self.folder = folder
        self.linuxcnc = linuxcnc
        self.bags = folder / "bags"
        self.bags.mkdir(parents=True, exist_ok=True)
        self.device_log = DeviceLog(folder / "device.log")
        path = install(folder / "drivers")
        before = os.environ.get("PYTHONPATH")
        os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (path, before)))
        made = {node.name: node for node in self._nodes(factor)}
        self.nodes = {name: made[name] for name in (*NODES, "sequencer") if name in made}
        self._stack = ExitStack()

    def _nodes(self, factor):
        if self.linuxcnc is None:
            nodes = simulated_cell(PLAN, MACHINE, CELL, self.bags, factor, 0.0, 1)
            inner, settings = "simulated", {}
        else:
            inner, settings = "linuxcnc", {"socket": str(self.linuxcnc.socket)}
            file = self._file("linuxcnc", settings)
            nodes = twin_cell(PLAN, MACHINE, CELL, self.bags, inner, file)
        for node in nodes:
            # A simulated cell waits longer; what is judged here is how fast a machine is stopped.
            for name in PATIENT:
                node.parameters.pop(name, None)
            if node.name == "bridge":
                told = {"driver": inner, "settings": settings, "log": str(self.device_log._file)}
                yield self._faulty(node, told, ("cell",))
            elif node.name == "interferometer":
                given = node.parameters
                own = {
                    "seed": given["seed"],
                    "hold_after_s": given["hold_after"],
                    "weather_age_s": given["weather_age"],
                    "weather_begins_ns": given["weather_begins"],
                }
                told = {"driver": "simulated", "settings": own}
                yield self._faulty(node, told, ("cell", "rate", "seed", "hold_after"))
            else:
                yield node

    def _faulty(self, node, told, dropped):
        told = {**told, "cell": CELL, "faults": str(self.folder / f"{node.name}.json")}
        given = {name: value for name, value in node.parameters.items() if name not in dropped}
        given |= {"device": "faulty", "device_file": self._file(node.name, told)}
        return NodeProcess(node.name, given | {"retry_after": 0.5})

    def _file(self, name, told):
        file = self.folder / f"{name}.yaml"
        file.write_text(yaml.safe_dump(told))
        return str(file)

    def __enter__(self):
        import rclpy

        from stepdiag_ros import topics
        from stepdiag_ros.nodes.operator import OperatorNode

        self.processes = Processes(list(self.nodes.values()), self.folder / "logs")
        self._stack.enter_context(self.processes)
        rclpy.init(args=[])
        self._stack.callback(rclpy.try_shutdown)
        self.operator = OperatorNode()
        self.settled, self.entered_running, self._was = 0, 0, None
        self.operator.listen(topics.STOP, self._on_stop)
        self.operator.listen(topics.RUN_STATE, self._on_state)
        if not self.operator.spin_until(self.all_well, START_LIMIT):
            raise ValueError(f"not all nodes are up: {self.troubles()}")
        return self

    def __exit__(self, *given):
        return self._stack.__exit__(*given)

    def _on_stop(self, _):
        self.settled += 1

    def _on_state(self, told):
        self.entered_running += told.state == State.RUNNING != self._was
        self._was = told.state

    def troubles(self):
        """Return sentences on the nodes that are not there, or not well."""
        watch = self.operator.watch
        roles = [ROLES.get(name, name) for name in self.nodes]
        return watch.missing(tuple(roles))

    def all_well(self):
        """Say whether all nodes are there and well."""
        return not self.troubles()

    def rest(self, seconds):
        """Only listen for a time."""
        self.operator.spin_until(lambda: False, seconds)

    def insist(self, ask, limit):
        """Ask as an operator does: again, until what was broken is there again."""
        deadline = time.monotonic() + limit
        while True:
            try:
                return ask()
            except ValueError:
                if time.monotonic() > deadline:
                    raise
                self.rest(0.2)

    def state(self):
        """Return the state of the run; None before it is known."""
        told = self.operator.state
        return None if told is None else State(told.state)

    def bag_closed(self, run_id):
        """Say whether the recorder has closed the bag of a run."""
        recorders = [p for p in self.operator.watch.peers.values() if p.role == "recorder"]
        return any(p.text.startswith("ready; recorded") and run_id in p.text for p in recorders)


def put(cell, fault):
    """Let a fault happen; return what sees to it again, which an operator does."""
    if fault["where"] in ("laser", "cnc"):
        name = "interferometer" if fault["where"] == "laser" else "bridge"
        if cell.linuxcnc is not None and name == "bridge" and fault["kind"] == "estop":
            cell.linuxcnc.operate("STATE_ESTOP")
            return lambda: cell.linuxcnc.operate("STATE_ESTOP_RESET", "STATE_ON")
        if cell.linuxcnc is not None and name == "bridge" and fault["kind"] == "encoder":
            axis = "XYZ"[fault["number"] % 3]
            cell.linuxcnc.freeze(axis)
            return lambda: (
                cell.linuxcnc.thaw(axis),
                cell.linuxcnc.operate("STATE_ON"),
            )
        file = cell.folder / f"{name}.json"
        new = file.with_suffix(".new")
        new.write_text(json.dumps(fault | {"until": time.monotonic() + fault["duration"]}))
        new.replace(file)
        return lambda: cell.rest(fault["duration"])
    process = cell.processes.running[fault["kind"]]
    if fault["where"] == "kill":
        process.kill()
        process.wait()
        return lambda: cell.processes.start(cell.nodes[fault["kind"]])
    process.send_signal(signal.SIGSTOP)
    return lambda: (cell.rest(fault["duration"]), process.send_signal(signal.SIGCONT))


class FaultyRun:
    """One run of a cell, with faults one after the other until it is finished or lost."""

    def __init__(self, cell):
        if not cell.operator.spin_until(cell.all_well, START_LIMIT):
            raise ValueError(f"the cell is not well again: {'; '.join(cell.troubles())}")
        self._cell = cell
        self._operator = cell.operator
        self.run_id = cell.insist(cell.operator.start, 20.0)
        self.faults = []
        self.complaints = []
        # Holds that no fault was put in for.
        self._unasked = {"held": [], "resumed": 0}
        self.lost = False
        cell.operator.spin_until(lambda: cell.state() is State.RUNNING, RUN_LIMIT)

    def over(self):
        """Say whether the run will not go on any more."""
        return self.lost or self._cell.state() in (State.FINISHED, State.ABORTED)

    def wait_for(self, fault):
        """Wait for the moment of a fault; say whether the run still goes on then."""
        cell, wanted = self._cell, self._cell.settled + fault["after_stops"]
        deadline = time.monotonic() + RUN_LIMIT
        while not self.over() and cell.settled < wanted and time.monotonic() < deadline:
            self._operator.spin_until(
                lambda: self.over() or cell.settled >= wanted or cell.state() is State.FAULT, 5.0
            )
            if cell.state() is State.FAULT:
                # A computer that is busy is a fault of its own.
                self._resume_until_well(self._unasked, lambda: None)
        cell.rest(fault["delay"])
        return not self.over()

    def bear(self, fault):
        """Put a fault into the run; see to it, and resume whenever the run is held."""
        cell = self._cell
        found = {**fault, "run": self.run_id, "held": [], "resumed": 0}
        self.faults.append(found)
        begun = time.monotonic()
        see_to_it = put(cell, fault)
        dead = fault["where"] == "kill"
        if fault["kind"] == "estop":
            self._operator.spin_until(
                lambda: cell.state() is State.FAULT or self.over(), STOP_LIMIT
            )
            if cell.state() is not State.FAULT and not self.over():
                self._complain(f"an emergency stop, but the run is {cell.state().name}")
        if fault["kind"] == "sequencer":
            self._must_stand(begun, fault)
        if fault["kind"] == "sequencer" and dead:
            self.lost = True
            see_to_it()
        elif dead:
            self._operator.spin_until(
                lambda: cell.state() is State.FAULT or self.over(), STOP_LIMIT
            )
            if cell.state() is not State.FAULT and not self.over():
                self._complain(f"{fault['kind']} is dead, but the run is {cell.state().name}")
            self._resume_until_well(found, see_to_it)
        elif cell.linuxcnc is not None and fault["kind"] in ("estop", "encoder"):
            cell.rest(fault["duration"])
            self._resume_until_well(found, see_to_it)
        else:
            see_to_it()
            self._resume_until_well(found, lambda: None)
        found["seconds"] = round(time.monotonic() - begun, 1)

    def finish(self):
        """See the run to its end."""
        deadline = time.monotonic() + RUN_LIMIT
        while not self.over() and time.monotonic() < deadline:
            self._resume_until_well(self._unasked, lambda: None)
        if not self.over():
            self._complain("the run has not ended in time")
        elif not self.lost and self._cell.state() is not State.FINISHED:
            self._complain(f"the run was not finished: {self._operator.state.text}")

    def judge(self):
        """Judge what was recorded; return what was found of each fault."""
        cell, wait = self._cell, 0.5 if self.lost else 15.0
        closed = self._operator.spin_until(lambda: cell.bag_closed(self.run_id), wait)
        bags = sorted(cell.bags.glob(f"*{self.run_id}*.mcap"), key=lambda bag: bag.stat().st_mtime)
        if not bags:
            self._complain("there is no bag")
        for bag in bags:
            try:
                readable = whole(bag, closed and bag is bags[-1])
                for sentence in (*wrong_lines(readable, CELL), *doubled(readable)):
                    self._complain(f"{bag.name}: {sentence}")
            except Exception as error:
                self._complain(f"{bag.name} cannot be read: {type(error).__name__}: {error}")
        if not self.complaints and closed:
            for bag in bags:
                bag.unlink()
        # Which fault of a run has spoilt it cannot be told by a machine: it counts for all.
        told = {"complaints": self.complaints, "held_besides": self._unasked["held"]}
        return [{**found, **told} for found in self.faults]

    def _is_held(self):
        """Say whether the run is held, or over, within the time that this may take."""
        cell = self._cell
        return self._operator.spin_until(
            lambda: cell.state() is State.FAULT or self.over(), STOP_LIMIT
        )

    def _complain(self, sentence):
        self.complaints.append(sentence)

    def _must_stand(self, begun, fault):
        """Without a sequencer a move ends, at its target or before, and no other begins."""
        cell = self._cell
        silent = 3.0 if fault["where"] == "kill" else fault["duration"]
        cell.rest(max(silent, 2.5) if fault["where"] == "kill" else 0.0)
        if fault["where"] != "kill":
            return
        now = time.monotonic()
        if cell.device_log.moves_at(now):
            self._complain("the machine still moves 2.5 s after the sequencer has died")
        if cell.device_log.starts_between(begun + 0.3, now):
            self._complain("a move was begun without a sequencer")

    def _resume_until_well(self, found, see_to_it):
        """Do what an operator does until the run goes on by itself, or is over."""
        cell, operator = self._cell, self._operator
        mended = False
        for _ in range(20):
            operator.spin_until(lambda: cell.state() is State.FAULT or self.over(), 1.5)
            if cell.state() is not State.FAULT:
                if not mended:
                    see_to_it()
                return
            found["held"].append(str(operator.state.text))
            self._must_stay_held()
            if not mended:
                see_to_it()
                mended = True
            try:
                cell.insist(lambda: operator.call("sequencer/resume"), 30.0)
            except ValueError as error:
                self._complain(f"the run cannot be resumed: {error}")
                operator.call("sequencer/abort")
                return
            found["resumed"] += 1
            operator.spin_until(lambda: cell.state() is not State.FAULT, 8.0)
        self._complain("resumed 20 times in vain")

    def _must_stay_held(self):
        cell = self._cell
        count = cell.entered_running
        cell.rest(HELD_FOR)
        # A machine that was just stopped may still brake; a computer that is busy, be late.
        deadline = time.monotonic() + STOP_LIMIT
        while cell.device_log.moves_at(time.monotonic()) and time.monotonic() < deadline:
            if cell.processes.running["bridge"].poll() is not None:
                # Its device went with it; one of its own has a dead-man for that.
                return
            cell.rest(0.2)
        if cell.device_log.moves_at(time.monotonic()):
            self._complain("the machine moves while the run is held")
        if cell.entered_running != count:
            self._complain("the run went on without an operator")


def campaign(cell, seed, numbers, tell, in_a_run=6):
    """Bear the faults of these numbers one after the other; return what was found of each."""
    left, results = list(numbers), []
    while left:
        run = FaultyRun(cell)
        while left and len(run.faults) < in_a_run and not run.over():
            fault = draw(seed, left[0], cell.linuxcnc is not None)
            if run.wait_for(fault):
                run.bear(fault)
                left.pop(0)
        run.finish()
        for found in run.judge():
            results.append(found)
            tell(found)
    return results


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, required=True, help="of bags, logs and results")
    parser.add_argument("--faults", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first fault")
    parser.add_argument("--factor", type=float, default=8.0, help="of simulated time")
    parser.add_argument("--linuxcnc", action="store_true", help="on LinuxCNC, in real time")
    arguments = parser.parse_args()
    results_file = arguments.folder / "results.jsonl"
    arguments.folder.mkdir(parents=True, exist_ok=True)
    done = []
    if results_file.exists():
        done = [json.loads(line) for line in results_file.read_text().splitlines()]
    wanted = range(arguments.first, arguments.first + arguments.faults)
    left = [number for number in wanted if number not in {one["number"] for one in done}]

    def tell(found):
        with results_file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(found) + "\n")
        words = "; ".join(found["complaints"]) or "borne"
        print(f"{found['number']}: {found['where']} {found['kind']}: {words}", flush=True)

    with ExitStack() as stack:
        linuxcnc = None
        if arguments.linuxcnc:
            from stepdiag_ros.devices.cnc.linuxcnc_instance import LinuxCncInstance

            linuxcnc = stack.enter_context(LinuxCncInstance(arguments.folder / "linuxcnc"))
        cell = stack.enter_context(Cell(arguments.folder, arguments.factor, linuxcnc))
        done += campaign(cell, arguments.seed, left, tell)
    failed = [one for one in done if one["complaints"]]
    summary = {
        "faults": len(done),
        "not_borne": len(failed),
        "resumed": sum(one["resumed"] for one in done),
        "by_kind": {},
    }
    for one in done:
        kind = f"{one['where']} {one['kind']}"
        count = summary["by_kind"].setdefault(kind, {"faults": 0, "not_borne": 0, "held": 0})
        count["faults"] += 1
        count["not_borne"] += bool(one["complaints"])
        count["held"] += bool(one["held"])
    (arguments.folder / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    print(json.dumps(summary, indent=2))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
