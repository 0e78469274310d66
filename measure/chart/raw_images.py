"""Writes the raw images of a chart: every run and the reference as .exr, and index.json."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler.io.replace_file import replace_file
from ...render.image import image_files
from ...render.image.image import Image
from ..records import Reference, Run, Setting

INDEX = "index.json"


class RawImageWriter:
    """Writes images as they are measured, and the index at the end. Raises OSError on a disk error."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self.runs: list[dict[str, Any]] = []

    def write_run(self, setting: Setting, curve: str, run: Run, errors: dict[str, float]) -> None:
        """Write a run; `errors` are its measured errors."""
        name = re.sub(r"[^\w.-]+", "_", f"{len(self.runs):04d}-{setting.backend}-{curve}-{setting.value}-seed{run.seed}.exr")
        alpha = np.ones(run.rgb.shape[:2], np.float32) if run.alpha is None else run.alpha
        self._write(name, run.rgb, alpha)
        self.runs.append(
            {
                "file": name, "backend": setting.backend, "curve": curve, "knob": setting.knob, "value": setting.value, "seed": run.seed,
                "arguments": setting.arguments(), "seconds": dict(run.seconds), "cpu": run.cpu, "errors": errors,
                "coverage": run.alpha is not None,
            }
        )  # fmt: skip

    def finish(self, reference: Reference, exposure: float) -> None:
        """Write the reference, its variance as a second picture, and the index."""
        alpha = np.ones(reference.rgb.shape[:2]) if reference.alpha is None else reference.alpha
        self._write("reference.exr", reference.rgb, alpha)
        self._write("reference-variance.exr", reference.variance, np.ones_like(alpha))
        about = {
            "file": "reference.exr", "variance": "reference-variance.exr", "how": reference.how, "samples": reference.samples,
            "seeds": list(reference.seeds),
        }  # fmt: skip
        text = json.dumps({"reference": about, "exposure": exposure, "runs": self.runs}, indent=1, ensure_ascii=False)
        replace_file(self.folder / INDEX, (text + "\n").encode())

    def _write(self, name: str, rgb: NDArray[np.floating], alpha: NDArray[np.floating]) -> None:
        height, width = alpha.shape
        rgba = np.dstack([rgb, alpha]).astype(np.float32)
        picture = Image(width, height, {"rgba": rgba}, {"size": (width, height), "crop": (0, 0, width, height)})
        image_files.write(picture, self.folder / name, image_files.Look(), {})
