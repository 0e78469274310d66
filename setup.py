"""Lists the packages for setuptools: this folder is the package `maquette`, and pyproject.toml cannot put that name before theirs."""

import warnings

from setuptools import find_packages, setup

warnings.filterwarnings("ignore", r"\s*Editable installation")  # it asks for care with a folder `maquette`: there is none
FOLDERS = find_packages(exclude=["bench", "bench.*", "tests", "tests.*", "build", "build.*"])

setup(packages=["maquette", *(f"maquette.{name}" for name in FOLDERS)], script_name="setup.py")  # which is then not a module of `maquette`
