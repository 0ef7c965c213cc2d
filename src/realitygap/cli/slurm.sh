#!/bin/bash
# {command}
# as {shards} jobs of a Slurm array:
#     jobs=$(sbatch --parsable THIS_FILE)
# and, when all of them are done, put together:
#     sbatch --dependency=afterok:$jobs --cpus-per-task={cores} --time={hours}:00:00 --wrap {wrapped}
# What the cluster asks for besides (--account, --partition, --mem) is given to both.
#SBATCH --job-name=realitygap
#SBATCH --array=1-{shards}
#SBATCH --ntasks=1
#SBATCH --cpus-per-task={cores}
#SBATCH --time={hours}:00:00
#SBATCH --requeue
set -euo pipefail
cd {here}
{python} -m realitygap {words} --shard "$SLURM_ARRAY_TASK_ID/{shards}" --workers {cores}{resume}
