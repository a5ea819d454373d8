"""A sweep on three local Ray nodes, one of which is killed midway, has the table of one machine.

Called with the program, an experiment and the folder of that machine's table; working directory above them all.
"""

import json
import sys
import tempfile
import threading
import time
from pathlib import Path

import ray
from ray.cluster_utils import Cluster

sys.path.insert(0, str(Path(__file__).parent.parent))

import boresight_ray  # noqa: E402
from boresight_ray.sweep import known_shards  # noqa: E402

# Ray hands the driver's path on; workers are to have the package by what the driver ships alone.
sys.path.pop(0)


def main() -> None:
    binary, experiment, alone = (Path(argument) for argument in sys.argv[1:4])
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    lost = cluster.add_node(num_cpus=1)
    cluster.add_node(num_cpus=1)
    ray.init(address=cluster.address, runtime_env=boresight_ray.RUNTIME_ENV, log_to_driver=False)
    assert len([node for node in ray.nodes() if node["Alive"]]) == 3
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)

        def kill() -> None:
            # Midway: some shards are there, others are not.
            while not list(out.glob("runs-*.jsonl")):
                time.sleep(0.01)
            cluster.remove_node(lost, allow_graceful=False)

        killer = threading.Thread(target=kill, daemon=True)
        killer.start()
        swept = boresight_ray.sweep(experiment, out, binary, 12)
        killer.join()
        assert swept.exit_code == 0 and "12 runs" in swept.text, swept
        assert known_shards(out) == 12
        for name in ["table.csv", "table.parquet", "failed.csv"]:
            assert (out / name).read_bytes() == (alone / name).read_bytes(), name
        # A run that failed is made again, the others of its shard are not.
        path = out / "runs-1-of-12.jsonl"
        header, run = path.read_text().splitlines()
        failed = {**json.loads(run), "result": {"Err": "no memory"}}
        path.write_text(f"{header}\n{json.dumps(failed)}\n")
        again = boresight_ray.sweep(experiment, out, binary, 12)
        assert again.exit_code == 0, again
        assert len(path.read_text().splitlines()) == 3
        assert (out / "table.csv").read_bytes() == (alone / "table.csv").read_bytes()
    # Ray learns of a node's death by its silence.
    for _ in range(120):
        alive = sum(node["Alive"] for node in ray.nodes())
        if alive == 2:
            break
        time.sleep(0.5)
    for wrong, program in [("nowhere.toml", binary), (experiment, Path("nowhere"))]:
        try:
            boresight_ray.sweep(Path(wrong), Path(folder), program, 2)
            raise AssertionError("what is not there was taken")
        except boresight_ray.SweepError as error:
            assert "nowhere" in str(error), error
    assert alive == 2, alive
    print("same table")
    ray.shutdown()
    cluster.shutdown()


if __name__ == "__main__":
    main()
