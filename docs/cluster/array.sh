#!/usr/bin/env bash
#SBATCH --job-name=pps-vision
#SBATCH --array=1-8            # the shards; a few again: sbatch --array=2,7 array.sh …
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=2G
#SBATCH --time=04:00:00
# sbatch array.sh 'recs/*' --calib camchain.yaml --out results     (the words of `pps-vision batch`)
# Every shard tracks an eighth of the recordings, without a scheduler of its own.  Once all have ended, the same words with --collect
# write batch.csv.  Submitted again, a shard does what is left to do.  Exit codes are those of `batch`.
set -eu
export OMP_NUM_THREADS=1
exec pps-vision batch "$@" --shard "$SLURM_ARRAY_TASK_ID/8"
