#!/usr/bin/env bash
# A SLURM job: one training on NODES machines with GPUS GPUs each. `sbatch docs/cluster/slurm.sh`
#SBATCH --job-name=unproject
#SBATCH --nodes=2
#SBATCH --ntasks-per-node=1
#SBATCH --gpus-per-node=4
#SBATCH --cpus-per-task=16
#SBATCH --time=04:00:00
#SBATCH --signal=TERM@120
#SBATCH --requeue
set -euo pipefail

RUN=runs/mine                      # on a file system that all machines see, like the data
GPUS=${SLURM_GPUS_ON_NODE:-1}
MASTER=$(scontrol show hostnames "$SLURM_JOB_NODELIST" | head -n 1)

# The first start trains, a job that was requeued goes on.
if [ -f "$RUN/recipe.json" ]; then
    COMMAND=(resume "$RUN" --steps 20000)
else
    COMMAND=(train shapes --data my_masks.npz --steps 20000 --checkpoint-every 1000 --out "$RUN")
fi

# --signal asks two minutes before the time is up: the run saves and leaves.
srun .venv/bin/torchrun --nnodes "$SLURM_NNODES" --nproc-per-node "$GPUS" \
    --rdzv-id "$SLURM_JOB_ID" --rdzv-backend c10d --rdzv-endpoint "$MASTER:29500" \
    -m unproject "${COMMAND[@]}"
