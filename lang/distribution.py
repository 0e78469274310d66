"""Name and version of the distribution on the package index. The command and the import are called `maquette`."""

NAME = "maquette-render"  # as in pyproject.toml: `maquette` on the index is another program
VERSION = "0.1.0"


def install_command(extra: str = "") -> str:
    """The command that installs this project, with an optional group of packages."""
    return f"pip install {NAME}[{extra}]" if extra else f"pip install {NAME}"
