"""The shipped problem files go into the package when it is built: problems/ becomes occontrol/examples."""

from __future__ import annotations

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class WithProblems(build_py):
    """build_py, and then the problem files and their tables."""

    def run(self) -> None:
        super().run()
        if self.editable_mode:
            return
        target = Path(self.build_lib) / "occontrol" / "examples"
        target.mkdir(parents=True, exist_ok=True)
        for source in sorted(Path("problems").iterdir()):
            if source.suffix in (".yaml", ".npz", ".mat"):
                shutil.copyfile(source, target / source.name)


setup(cmdclass={"build_py": WithProblems})
