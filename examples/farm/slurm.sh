#!/usr/bin/env bash
# Many piles of a scene on Slurm. Each task of the array bakes its part of the seeds:
#
#     sbatch --array=0-15 examples/farm/slurm.sh SCENE OUT SEEDS EACH [FORMAT]
#     sbatch --array=0-15%8 examples/farm/slurm.sh examples/sticks.toml piles 0..63 4 usdc
#
# %8 lets at most eight tasks run at once. What stands below is for small scenes: examples/farm/requests.py SCENE --each EACH
# prints --cpus-per-task, --mem-per-cpu and --time for a scene, by the estimates of `cairn plan`; give them to sbatch.
#
# If a node fails, or Slurm takes it back, the task runs again elsewhere and bakes the missing results. For the latter case, the
# cluster's slurm.conf has `RequeueExit=75`: Cairn ends with this code after a signal.
#SBATCH --job-name=piles
#SBATCH --cpus-per-task=2
#SBATCH --mem-per-cpu=2G
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --output=piles-%A_%a.log
#SBATCH --time=04:00:00
# Slurm signals the task a minute before it ends it; Cairn needs less than two seconds.
#SBATCH --signal=B:TERM@60
set -euo pipefail
scene=$1 out=$2 seeds=$3 each=$4 format=${5:-glb}
first=$((SLURM_ARRAY_TASK_ID * each))
mkdir -p "$out"
# Each of the bakes has its share of the memory that Slurm gives to the task.
export CAIRN_MAX_MEMORY_MIB=${SLURM_MEM_PER_CPU:-$((SLURM_MEM_PER_NODE / SLURM_CPUS_PER_TASK))}
# Replaces this script, so that it gets the signal.
exec cairn batch "$scene" --seeds "$seeds" --range "$first-$((first + each - 1))" --jobs "$SLURM_CPUS_PER_TASK" \
    -o "$out/{seed}.$format" --progress plain
