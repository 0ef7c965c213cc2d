#!/bin/bash
# {command}
# as {shards} jobs of a Slurm array; submit it with
#     jobs=$(sbatch --parsable THIS_FILE)
# and, when all of them are done, merge the shards with
#     sbatch --dependency=afterok:$jobs --cpus-per-task={cores} --time={hours}:00:00 --wrap {wrapped}
# Give both whatever else the cluster needs (--account, --partition, --mem).
#SBATCH --job-name=realitygap
#SBATCH --array=1-{shards}
#SBATCH --ntasks=1
#SBATCH --cpus-per-task={cores}
#SBATCH --time={hours}:00:00
#SBATCH --requeue
set -euo pipefail
cd {here}
{python} -m realitygap {words} --shard "$SLURM_ARRAY_TASK_ID/{shards}" --workers {cores}{resume}
