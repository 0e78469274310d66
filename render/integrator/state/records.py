"""Records that the Whitted integrator passes between its stages."""

from __future__ import annotations

from typing import Any, NamedTuple

from ...material.shader import Shader
from ...types import Lane, Options, Surface, Tables, Vec, VertexLight


class Scene(NamedTuple):
    """The inputs of the integrator, the same for all rays of a picture."""

    tables: Tables
    accel: Any
    vertex_light: VertexLight | None  # read by `whitted.radiance` alone
    options: Options


class SampleIndex(NamedTuple):
    """The key of the random numbers of one surface on the tree of rays."""

    pixel: Lane
    sample: Lane
    key: Lane  # position of the surface in the tree of rays: 1 at the camera ray


class ShadingContext(NamedTuple):
    """A surface point with its evaluated material, as seen by one ray."""

    point: Surface
    shader: Shader
    viewer: Vec  # unit, against the ray
    inside: Any  # medium stack of the ray; None in scenes without media
    event: Any = None  # flights.Event; None in scenes without scattering media


class RayState(NamedTuple):
    """State of a ray on the stack, beside its origin."""

    direction: Vec
    weight: Vec  # throughput: the factor of the ray's radiance in the pixel
    left: Lane  # bounces left
    kind: Lane  # DIFFUSE_RAY, SPECULAR_RAY or STRAIGHT_RAY of `ray_stack`
    inside: Any  # medium stack
    key: Lane  # of its random numbers
    links: Any = None  # light links of the surface that it leaves, see links.bits_of


class LightSample(NamedTuple):
    """A sample of a light at a surface, before its shadow test."""

    light: int  # row of Lights
    origin: Vec  # of the shadow ray, before its offset
    direction: Vec
    distance: Lane  # to the light
    radiance: Vec  # reflected toward the viewer if the light is visible
