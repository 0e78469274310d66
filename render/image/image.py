"""Image: named float32 channels and metadata."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ...compiler.io import child_process
from ...lang.schema import setting_values
from ...lang.schema.picture_channels import CHANNELS, CRYPTOMATTES, component_names
from . import metrics, tone_curves

WIDTHS = {"rgba": 4, **{name: len(component_names(name)) for name in CHANNELS}, **dict.fromkeys(CRYPTOMATTES, 12)}
"""Components of each channel. rgba: scene-linear, unexposed, alpha is coverage; crypto_…: see cryptomatte.py; others: see CHANNELS. Light
groups, `light:NAME`, have three."""
LIGHT = 3


@dataclass(frozen=True, eq=False)
class Image:
    """`width` by `height` pixels (of the crop); each channel is (height, width, k) float32.

    `metadata` as film.run fills it: "size" and "crop" (x0, y0, x1, y1) of the whole picture, "samples" (the most any pixel has),
    "samples_mean", "error" (estimated √relMSE, None where unknown), "error_in_few" (share of its square in stray bright samples, see
    film.stray_samples),
    "variance" (of the pixels' means, (height, width, 3), inf where unknown; None after one sample), "half_difference" (float32, its square
    is the variance: the halves of the samples are about the picture ± it), "variance_share" (by which Sobol points reduce the variance),
    "partial", "rays" (from the camera), "issues" (samples left out because they were not finite), "threads". render_scene.draw adds
    "seconds" by stage, "backend", "notes", "unproved", "cut" and "attributes" (file attributes of the channels), "exposure", "view" and
    "transparent" for `save`, "bias" and "left_out" (light that more samples do not add), and of denoised pictures "denoised" and
    "denoised_error" (estimated √relMSE).

    numpy.asarray(image) is the rgba channel: scene-linear, alpha is coverage.
    """

    width: int
    height: int
    channels: dict[str, NDArray[np.float32]]
    metadata: dict[str, Any] = field(default_factory=dict)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """(height, width, 4) rgba, for numpy."""
        return np.array(self.channels["rgba"], dtype=dtype, copy=copy)

    @property
    def diagnostics(self) -> tuple[Any, ...]:
        """Warnings and notes about the picture, of maquette.render: lang.diagnostics.Diagnostic."""
        return tuple(self.metadata.get("diagnostics", ()))

    def __repr__(self) -> str:
        how = [str(self.metadata[key]) for key in ("backend",) if key in self.metadata]
        how += [f"{self.metadata['samples']:g} samples a pixel"] if "samples" in self.metadata else []
        return f"<Image {self.width}x{self.height}, {', '.join((*how, f'channels {chr(32).join(self.channels)}'))}>"

    def save(
        self, path: str | Path, *, exposure: float | Literal["metered"] | None = None, view: str | None = None, bits: int | None = None
    ) -> None:
        """Write the picture, or replace a file by it, as a whole. The extension of `path` gives the format.

        An .exr holds every channel, linear and unexposed. Other formats show `exposure` stops (default: the scene's) through `view`
        with 8 or 16 `bits`. Raises image_files.FormatError for a name, view or depth that does not exist, ValueError for a
        wrong exposure, OSError without a file.
        """
        from . import image_files

        path, about = Path(path), self.metadata
        stops, seen = about.get("exposure", 0.0) if exposure is None else exposure, view or about.get("view", "sRGB")
        colors = {name: str(about.get(name, "")) for name in ("ocio", "display", "look")}
        if view is not None and view in tone_curves.CURVES:
            colors["display"] = colors["look"] = ""
        if stops != "metered":
            stops = setting_values.exposure(stops)
        look = image_files.Look(0.0, seen, bits or 8, bool(about.get("transparent")), float(about.get("white", 0.0)), **colors)
        image_files.check(path, (), bits, look)
        if stops == "metered":
            stops = image_files.auto_exposure(self.channels["rgba"], int(self.metadata.get("threads", 0)))
        image_files.write(self, path, replace(look, exposure=float(stops)), {"exposure": float(stops)})

    def show(self) -> None:
        """Open the picture in the desktop's viewer, as a temporary PNG file."""
        path = Path(tempfile.mkdtemp(prefix="maquette-")) / "image.png"
        self.save(path)
        child_process.browse(path.as_uri())

    def _repr_png_(self) -> bytes:
        """The picture in a notebook."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "image.png"
            self.save(path)
            return path.read_bytes()

    @property
    def luminance(self) -> NDArray[np.float64]:
        """(height, width) relative luminance."""
        return metrics.luminance(self.channels["rgba"][..., :3])


def blank(width: int, height: int, names: tuple[str, ...]) -> dict[str, NDArray[np.float32]]:
    """Return the channels of an empty picture."""
    channels: dict[str, NDArray[np.float32]] = {}
    for name in names:
        shape, empty = (height, width, WIDTHS.get(name, LIGHT)), CHANNELS[name].empty if name in CHANNELS else 0.0
        channels[name] = np.full(shape, empty, np.float32) if empty else np.zeros(shape, np.float32)  # zeros take no time before their use
    return channels
