"""kinid on the nodes of a batch system, by dask-jobqueue: `python batch_system.py SLURM contact LOGS -o FRAMES`.

The first word names the system as dask-jobqueue does (SLURM, PBS, SGE, LSF, HTCondor …; Local for this machine alone),
the others are a command of kinid. Logs and results lie where all nodes see them: a shared disk, or s3://.
"""

from __future__ import annotations

import importlib
import os
import subprocess
import sys

#: of a job: processes, one a core, and their memory; a log of a minute takes about 1 GB while it is fitted
CORES = int(os.environ.get("KINID_CORES", "8"))
MEMORY = os.environ.get("KINID_MEMORY", f"{2 * CORES}GB")
WALLTIME = os.environ.get("KINID_WALLTIME", "04:00:00")
#: jobs at most, and the network card that nodes see each other by
JOBS, INTERFACE = int(os.environ.get("KINID_JOBS", "20")), os.environ.get("KINID_INTERFACE")


def main() -> int:
    """Begin a scheduler here and workers there, run the command on them, and end both."""
    system, *words = sys.argv[1:]
    module = importlib.import_module("dask_jobqueue.local" if system == "Local" else "dask_jobqueue")
    kind = getattr(module, f"{system}Cluster")
    more = {}
    if system != "Local":
        # a log is one thread's work
        more = {"walltime": WALLTIME, "job_script_prologue": ["export OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1"]}
    with kind(cores=CORES, processes=CORES, memory=MEMORY, interface=INTERFACE, **more) as cluster:
        cluster.adapt(minimum_jobs=1, maximum_jobs=JOBS)
        command = [sys.executable, "-m", "kinid", *words, "--on", cluster.scheduler_address]
        return subprocess.run(command, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
