"""Random faults in runs of a machine under ros2_control: is every one named, every line right?

Each run has the eight kinds of faults of ``test/devices/cnc_peers/joint_faults.py`` in a random
order, in random moves and at random moments; the controller is the peer of the tests. A run bears
its faults if each one holds the run and is named, no move is lost or made twice, only lines that
were broken off are measured again, and lines and result are those of the simulated machine. The
exit code is 1 if one run did not.

    python benchmarks/joint_faults.py --folder FOLDER --runs 25 --seed 1
"""

import argparse
import json
import sys
import time
from contextlib import redirect_stdout
from pathlib import Path

ROOT = Path(__file__).parents[1]
for _room in ("test", "test/devices/cnc_peers"):
    sys.path.insert(0, str(ROOT / _room))

import stepdiag_ros.client  # noqa: E402, F401 - makes rclpy importable


def judged(folder, seed):
    """Measure one run with its faults; return what was not borne, in words."""
    from joint_faults import SETTINGS, Faults, at_random, check_holds, check_lines, check_moves
    from peer_run import PeerRun, check_displacements, check_result
    from trajectory_peer import TrajectoryPeer

    from stepdiag_ros.bags.run import load_run

    folder.mkdir(parents=True)
    peer = TrajectoryPeer()
    faults = Faults(peer, at_random(seed))
    finished = PeerRun(folder, "ros2_control", SETTINGS, faults.mend, peer)
    recorded = load_run(finished.bag)
    failed = []
    for check, given in (
        (check_holds, (finished, faults)),
        (check_moves, (finished, peer)),
        (check_lines, (finished, recorded)),
        (check_displacements, (recorded,)),
        (check_result, (recorded,)),
    ):
        try:
            check(*given)
        except AssertionError as error:
            failed.append(f"{check.__name__}: {error}")
    return faults.begun, failed


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, required=True, help="of bags and logs")
    parser.add_argument("--runs", type=int, default=25, help="of eight faults each")
    parser.add_argument("--seed", type=int, default=1, help="of the first run")
    arguments = parser.parse_args()
    begin, faults, failed = time.perf_counter(), 0, {}
    for seed in range(arguments.seed, arguments.seed + arguments.runs):
        # The checks print their figures.
        with redirect_stdout(sys.stderr):
            begun, wrong = judged(arguments.folder / str(seed), seed)
        faults += len(begun)
        if wrong:
            failed[seed] = {"begun": begun, "wrong": wrong}
        passed = time.perf_counter() - begin
        said = "not borne" if wrong else "borne"
        print(f"{passed:7.0f} s  run {seed}: {len(begun)} faults {said}", file=sys.stderr)
    print(json.dumps({"runs": arguments.runs, "faults": faults, "not_borne": failed}, indent=2))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
