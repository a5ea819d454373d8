#!/usr/bin/env bash
#SBATCH --job-name=boresight
#SBATCH --array=1-32
#SBATCH --cpus-per-task=1
# A sweep as a Slurm array: `sbatch examples/slurm.sh experiments/dwell.toml out/dwell`, and when all tasks are over
# `boresight sweep experiments/dwell.toml --out out/dwell --merge`. The folder must lie where all nodes see it. A task
# ends with 1 where some of its runs failed; `sbatch --array=5 examples/slurm.sh …` makes those of task 5 again.
set -euo pipefail
experiment=$1
out=$2
shards=32 # as many as the array above has, also where one task is made again
exec boresight sweep "$experiment" --out "$out" --jobs 1 \
  --shard "$SLURM_ARRAY_TASK_ID/$shards"
