"""Studies: one problem varied over values, methods and seeds; files are the database, the engine is replaceable."""

from occontrol.studies.study_file import Study, read_study

__all__ = ["Study", "read_study"]
