#!/usr/bin/env bash
#SBATCH --job-name=pps-vision
#SBATCH --ntasks=32            # recordings that are tracked at once
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=2G
#SBATCH --time=04:00:00
# sbatch slurm.sh 'recs/*' --calib camchain.yaml --out results     (the words of `pps-vision batch`)
# Recordings and results lie on a file system that all nodes share.  Submitted again, it does what is left to do.
# The job's exit code is that of `batch`: 0 all recordings done, 1 some failed, 2 none done or the words are wrong.
set -eu
export OMP_NUM_THREADS=1
folder=$(mktemp -d "$PWD/.dask-XXXXXX")  # for its owner alone
file=$folder/scheduler.json
trap 'kill $(jobs -p) 2>/dev/null || true; rm -rf "$folder"' EXIT
# A certificate for this job: whoever cannot read it cannot reach the scheduler or the workers, which run any code they are sent.
openssl req -x509 -newkey rsa:3072 -nodes -days 30 -subj /CN=pps-vision -keyout "$folder/key.pem" -out "$folder/cert.pem" 2>/dev/null
tls=(--protocol tls --tls-ca-file "$folder/cert.pem" --tls-cert "$folder/cert.pem" --tls-key "$folder/key.pem")
dask scheduler "${tls[@]}" --scheduler-file "$file" --port 0 --no-dashboard &
scheduler=$!
srun dask worker "${tls[@]}" --scheduler-file "$file" --nthreads 1 --no-nanny --no-dashboard &
until [ -s "$file" ]; do kill -0 $scheduler; sleep 0.2; done
pps-vision batch "$@" --scheduler "$file" --tls "$folder"
