"""Builds the site of docs/ into build/site with mkdocs-material: `make site`, or python tools/site.py FOLDER.

The pages link to files of the whole repository. The pages, and every file that they link to, are copied to FOLDER/source at their places in
the repository. mkdocs builds FOLDER/html from there. The site loads nothing from elsewhere: no fonts, no scripts.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parent.parent
NAV = {
    "Start": ["README.md", "docs/tutorial.md", "docs/language.md", "docs/howto.md", "docs/coming_from.md"],
    "Library": ["docs/library.md", "docs/gallery.md", "examples/README.md"],
    "Use": ["docs/live.md", "docs/editors.md", "docs/python.md", "docs/solids.md", "docs/light.md", "docs/usd.md", "docs/materialx.md",
        "docs/gltf.md",
            "docs/meshes.md", "docs/compare.md", "docs/charts.md", "docs/environment.md", "docs/course.md"],
    "Reference": ["docs/reference.md", "docs/accuracy.md", "bench/RESULTS.md", "CHANGELOG.md"],
    "Develop": ["CONTRIBUTING.md", "docs/architecture.md", "docs/reading.md", "docs/simd.md"],
}  # fmt: skip
OTHERS = "Use"  # the section of the pages of docs/ that NAV does not name
LINK = re.compile(r"(?<=\]\()([^)#\s]+)(?=[)#])")
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
LIST = re.compile(r"^(?![-*#|>\s]|\d+\.)(.+)\n(?=(?:- |1\. ))", re.MULTILINE)
CONFIG = {
    "site_name": "maquette",
    "use_directory_urls": False,
    "docs_dir": "source",
    "site_dir": "html",
    "theme": {"name": "material", "font": False, "features": ["navigation.sections", "navigation.top", "search.suggest"],
              "palette": {"scheme": "default", "primary": "blue grey"}},
    "plugins": ["search"],
    "markdown_extensions": ["tables", "sane_lists", {"toc": {"permalink": False}}, "pymdownx.superfences",
                            {"pymdownx.highlight": {"use_pygments": True, "guess_lang": False}}],
    "validation": {"omitted_files": "ignore", "absolute_links": "warn", "unrecognized_links": "ignore", "anchors": "warn"},
    "extra": {"generator": False},
}  # fmt: skip


def linked(page: Path) -> list[Path]:
    """The files that a page links to."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    targets = [(page.parent / link).resolve() for link in LINK.findall(text) if "://" not in link]
    return [path for path in targets if path.is_relative_to(ROOT) and path.exists()]


def sections() -> dict[str, list[str]]:
    """The pages of each section: those of NAV, and the other pages of docs/."""
    named = {page for pages in NAV.values() for page in pages}
    others = sorted(path.relative_to(ROOT).as_posix() for path in [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs/reference").glob("*.md")])
    return {title: pages + [page for page in others if page not in named] * (title == OTHERS) for title, pages in NAV.items()}


def lay_out(source: Path) -> None:
    """Copy the pages and all files that they link to, and those that linked pages link to."""
    waiting = [ROOT / page for pages in sections().values() for page in pages]
    seen: set[Path] = set()
    while waiting:
        path = waiting.pop()
        if path in seen:
            continue
        seen.add(path)
        if path.is_dir():
            waiting += [path / "README.md"] * (path / "README.md").exists()
            continue
        target = source / path.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix != ".md":
            shutil.copyfile(path, target)
            continue
        text = path.read_text(encoding="utf-8")
        target.write_text(_for_mkdocs(text, path), encoding="utf-8")
        waiting += linked(path)


def _for_mkdocs(text: str, page: Path) -> str:
    """A page with what GitHub's Markdown does without: an empty line before a list, and the file of a folder's link."""

    def readme_link(match: re.Match[str]) -> str:
        folder = page.parent / match[1]
        return f"{match[1].rstrip('/')}/README.md" if folder.is_dir() and (folder / "README.md").exists() else match[1]

    parts = re.split(r"(^```.*?^```)", text, flags=re.MULTILINE | re.DOTALL)
    return "".join(part if part.startswith("```") else LINK.sub(readme_link, LIST.sub(r"\1\n\n", part)) for part in parts)


def build(folder: Path) -> int:
    """Build the site below a folder, strictly: a broken link is an error. Returns the exit code of mkdocs."""
    shutil.rmtree(folder, ignore_errors=True)
    lay_out(folder / "source")
    config = {**CONFIG, "nav": [{title: pages} for title, pages in sections().items()]}
    (folder / "mkdocs.yml").write_text(yaml.safe_dump(config, sort_keys=False), encoding="utf-8")
    command = [sys.executable, "-P", "-m", "mkdocs", "build", "--strict", "-f", str(folder / "mkdocs.yml")]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"})
    for line in (done.stdout + done.stderr).splitlines():
        if not line.startswith("INFO"):
            print(line)
    return done.returncode


if __name__ == "__main__":
    sys.exit(build(Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "build" / "site").resolve()))
