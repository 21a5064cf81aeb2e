#!/usr/bin/python3
"""Learning: how fast, against the same in SciPy; and what a correction is worth on a machine.

    tests/bench/learn.py [BUILD_DIR] [--speed]        --speed: only how fast

The machine shares no code with the twin (tests/bench/learn_study.cpp). CPU time of one core.
"""

import argparse
import json
import pathlib
import sys
import tempfile

sys.dont_write_bytecode = True
from common import introduce, on_one_core, output_of, table  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent


def speed(build):
    with tempfile.TemporaryDirectory(prefix="servotwin-bench-") as scratch:
        path = pathlib.Path(scratch) / "path.csv"
        ours = json.loads(on_one_core(build / "bench_learn", path))
        peer = json.loads(on_one_core(HERE / "learn_peer.py", path, ours["bandwidth_hz"]))
    print("\nTen virtual trials of 10 s at 1 kHz, two axes with presliding friction, one core")
    both = (ours, peer)
    table(
        [
            ("", "servotwin", "SciPy"),
            ("learning, CPU time [s]", *(f"{run['learning_s']:.3f}" for run in both)),
            ("error before, X [um RMS]", *(f"{run['rms_um'][0]:.3f}" for run in both)),
            ("  Y", *(f"{run['rms_um'][1]:.3f}" for run in both)),
            ("best trial, X", *(f"{run['best_um'][0]:.4f}" for run in both)),
            ("  Y", *(f"{run['best_um'][1]:.4f}" for run in both)),
            ("norm-optimal step, 10,000 samples [s]", *(f"{run['lifted_s']:.3f}" for run in both)),
            ("  what it minimises [mm^2]", *(f"{1e6 * run['lifted_cost']:.6f}" for run in both)),
        ],
        (40, 12, 12),
    )
    print(f"  {peer['learning_s'] / ours['learning_s']:.0f} times faster (aim: under 1 s).")
    print(f"  The bandwidth from the uncertainty took {ours['bandwidth_s']:.3f} s.")
    print("  Ours starts from what the model says, SciPy's from nothing.")
    print(f"  The norm-optimal step within limits of peak and rate: {ours['lifted_limited_s']:.2f} s.")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", type=pathlib.Path, nargs="?", default=HERE.parents[1] / "build")
    parser.add_argument("--speed", action="store_true")
    arguments = parser.parse_args()
    introduce({})
    speed(arguments.build.resolve())
    if not arguments.speed:
        print(f"\n{output_of(arguments.build.resolve() / 'learn_study')}", end="")


if __name__ == "__main__":
    main()
