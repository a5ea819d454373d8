"""A sweep on three local Ray nodes, one of which is killed midway, has the table of one machine.

Called with the program, an experiment and the folder of that machine's table; working directory above them all.
"""

import sys
import tempfile
import threading
import time
from pathlib import Path

import ray
from ray.cluster_utils import Cluster

sys.path.insert(0, str(Path(__file__).parent.parent))

import boresight_ray  # noqa: E402


def main() -> None:
    binary, experiment, alone = (Path(argument) for argument in sys.argv[1:4])
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    lost = cluster.add_node(num_cpus=1)
    cluster.add_node(num_cpus=1)
    # Nodes import the package from where it lies.
    path = str(Path(__file__).parent.parent)
    ray.init(address=cluster.address, runtime_env={"env_vars": {"PYTHONPATH": path}}, log_to_driver=False)
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
        print(boresight_ray.sweep(experiment, out, binary, 12))
        killer.join()
        for name in ["table.csv", "table.parquet", "failed.csv"]:
            assert (out / name).read_bytes() == (alone / name).read_bytes(), name
    alive = sum(node["Alive"] for node in ray.nodes())
    try:
        boresight_ray.sweep(Path("nowhere.toml"), Path(folder), binary, 2)
        raise AssertionError("an experiment that is not there was taken")
    except boresight_ray.SweepError as error:
        assert "nowhere.toml" in str(error), error
    assert alive == 2, alive
    print("same table")
    ray.shutdown()
    cluster.shutdown()


if __name__ == "__main__":
    main()
