"""What runs the tasks of a study: processes of this machine, Dask, or SLURM; none of them keeps anything."""
