"""Command line: ``boresight-ray experiments/dwell.toml --out out/dwell --binary PATH``."""

import argparse
import shutil
import sys
from pathlib import Path

import ray

from .sweep import RUNTIME_ENV, SweepError, known_shards, sweep


def main() -> int:
    parser = argparse.ArgumentParser(prog="boresight-ray", description=__doc__)
    parser.add_argument("experiment", type=Path, help="experiment file, from the working directory")
    parser.add_argument("--out", type=Path, required=True, help="folder for journals, table and page")
    parser.add_argument("--binary", type=Path, help="the program; by default the boresight of the PATH")
    parser.add_argument("--shards", type=int, help="tasks; by default as many as the journals in --out are of, or four for each processor of the cluster")
    parser.add_argument(
        "--with", dest="more", type=Path, action="append", default=[],
        help="a further file or folder that runs read, such as assets/models; may be repeated",
    )
    parser.add_argument("--address", help="the cluster's address; by default Ray finds or starts one")
    arguments = parser.parse_args()
    binary = arguments.binary or shutil.which("boresight")
    if binary is None:
        print("error: no boresight in the PATH: name it with --binary", file=sys.stderr)
        return 2
    if not Path(binary).is_file():
        print(f"error: {binary}: is no file: name the program with --binary", file=sys.stderr)
        return 2
    if arguments.shards is not None and arguments.shards < 1:
        print(f"error: --shards {arguments.shards}: must be at least 1", file=sys.stderr)
        return 2
    try:
        shards = arguments.shards or known_shards(arguments.out)
        ray.init(address=arguments.address, runtime_env=RUNTIME_ENV, log_to_driver=False)
        shards = shards or max(1, 4 * int(ray.cluster_resources().get("CPU", 1)))
        swept = sweep(arguments.experiment, arguments.out, Path(binary), shards, arguments.more)
    except (SweepError, ConnectionError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(swept.text)
    return swept.exit_code


if __name__ == "__main__":
    sys.exit(main())
