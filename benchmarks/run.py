"""`make bench`: every speed claim of the project, as a ratio measured in one run."""

from __future__ import annotations

import argparse
import json

import heads
import lines
import million
import processes
import rendering
import silhouettes
import sooner
import torch

from unproject.training.run_directory import environment

BENCHMARKS = {
    "silhouettes": silhouettes.run,
    "heads": heads.run,
    "lines": lines.run,
    "rendering": rendering.run,
    "sooner": sooner.run,
    "million": million.run,
    "processes": processes.run,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(BENCHMARKS), help=", ".join(BENCHMARKS))
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    print(json.dumps({"environment": environment()}, indent=1))
    for name in options.names:
        print(json.dumps({name: BENCHMARKS[name]()}, indent=1), flush=True)


if __name__ == "__main__":
    main()
