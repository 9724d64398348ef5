"""SLURM: a script for a job array whose every element does one part of the study with `occontrol work`.

Nothing of SLURM is needed to write it. Starting the same array again does only what has no result yet.
"""

from __future__ import annotations

import math
import shlex
import sys
from pathlib import Path

from occontrol.files.atomic import write_text
from occontrol.studies.folder import StudyFolder

SCRIPT = "slurm.sh"


def write_array(folder: StudyFolder, tasks: int, tasks_per_job: int) -> tuple[Path, int]:
    """Write the script of the array; where it is and how many elements the array has.

    Parameters
    ----------
    folder : of the study
    tasks : how many the study has
    tasks_per_job : how many one element does, one after another
    """
    parts = max(1, math.ceil(tasks / tasks_per_job))
    home = folder.path.resolve()
    lines = [
        "#!/bin/bash",
        f"# sbatch --array=0-{parts - 1} --time=1:00:00 --mem=2G {shlex.quote(SCRIPT)}",
        "#SBATCH --job-name=occontrol",
        "#SBATCH --ntasks=1",
        "#SBATCH --cpus-per-task=1",
        "export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1",
        f'exec {shlex.quote(sys.executable)} -m occontrol work {shlex.quote(str(home))} '
        f'--part "${{SLURM_ARRAY_TASK_ID:?start it with sbatch --array}}/{parts}"',
    ]
    return write_text(folder.path / SCRIPT, "\n".join(lines) + "\n"), parts
