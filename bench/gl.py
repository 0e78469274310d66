"""OpenGL on Mesa's llvmpipe, offscreen, as a peer of the raster backend: same triangles, camera, shading and framebuffer."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import harness, meshes
from .meshes import Mesh

INSTALL = "pip install moderngl; Debian's libegl1 and libgl1-mesa-dri"
NEAR, FAR = 0.1, 20.0

_VERTEX = """
#version 330
uniform mat4 to_clip;
in vec3 position;
in vec3 normal;
in vec2 place;
out vec3 at;
out vec3 facing;
out vec2 uv;
void main() { at = position; facing = normal; uv = place; gl_Position = to_clip * vec4(position, 1.0); }
"""
_FRAGMENT = """
#version 330
uniform vec3 eye;
uniform vec3 light;
uniform vec3 diffuse;
uniform vec3 specular;
uniform float shininess;
in vec3 at;
in vec3 facing;
in vec2 uv;
uniform sampler2D image;
out vec4 color;
void main() {
    vec3 n = normalize(facing);
    vec3 v = normalize(eye - at);
    if (!gl_FrontFacing) n = -n;
    float cosine = dot(n, light);
    float lobe = cosine > 0.0 ? pow(max(dot(n, normalize(light + v)), 0.0), shininess) : 0.0;
    color = vec4(diffuse * IMAGE * max(cosine, 0.0) + specular * lobe, 1.0);
}
"""


class Window:
    """An offscreen context with one mesh, seen from meshes.EYE; `image` is (coordinates, texels)."""

    def __init__(self, mesh: Mesh, size: int, samples: int, uniforms: dict[str, Any], image: Any = None) -> None:
        moderngl = harness.need("moderngl", INSTALL)
        try:
            self.context = moderngl.create_context(standalone=True, backend="egl")
        except Exception as why:  # glcontext raises plain Exception
            raise harness.Missing(f"no OpenGL context can be made ({INSTALL})") from why
        gl = self.context
        shape, several = (size, size), samples if samples > 1 else 0
        self.frame = gl.framebuffer([gl.renderbuffer(shape, 4, samples=several)], gl.depth_renderbuffer(shape, samples=several))
        self.resolved = gl.framebuffer([gl.renderbuffer(shape, 4)]) if several else self.frame
        fragment = _FRAGMENT.replace("IMAGE", "vec3(1.0)" if image is None else "texture(image, uv).rgb")
        program = gl.program(vertex_shader=_VERTEX, fragment_shader=fragment)
        program["to_clip"].write(to_clip().T.astype(np.float32).tobytes())
        for name, value in {"eye": meshes.EYE, **uniforms}.items():
            program[name].value = value
        columns, layout, names = [mesh.positions, mesh.normals], "3f 3f", ["position", "normal"]
        if image is not None:
            coordinates, texels = image
            columns, layout, names = [*columns, coordinates], "3f 3f 2f", [*names, "place"]
            self.image = gl.texture(texels.shape[1::-1], 4, texels[::-1].tobytes())
            self.image.filter = moderngl.LINEAR, moderngl.LINEAR
            self.image.use()
        vertices = gl.buffer(np.hstack(columns).astype(np.float32).tobytes())
        self.mesh = gl.vertex_array(program, [(vertices, layout, *names)], gl.buffer(mesh.triangles.tobytes()), 4)
        gl.enable(moderngl.DEPTH_TEST)
        self.pixels = np.empty((*shape, 4), np.uint8)

    def draw(self) -> NDArray[np.uint8]:
        """Clear, draw, resolve, read back: (size, size, 4), the top row first."""
        self.frame.use()
        self.context.clear(0.0, 0.0, 0.0, 0.0)
        self.mesh.render()
        if self.resolved is not self.frame:
            self.context.copy_framebuffer(self.resolved, self.frame)
        self.resolved.read_into(self.pixels, components=4)
        return self.pixels[::-1]

    def version(self) -> str:
        """The renderer's name and version, such as llvmpipe (LLVM 15, 256 bits), Mesa 22.3."""
        return f"{self.context.info['GL_RENDERER']} {self.context.info['GL_VERSION']}"


def to_clip() -> NDArray[np.float64]:
    """(4, 4) world to clip space of the camera of meshes.scene: perspective, square, from NEAR to FAR."""
    view = np.eye(4)
    camera = meshes.look_at(meshes.EYE)
    view[:3, :3] = camera[:, :3].T
    view[:3, 3] = -camera[:, :3].T @ camera[:, 3]
    scale = 1.0 / meshes.EXTENT
    depth = (NEAR + FAR) / (NEAR - FAR), 2.0 * NEAR * FAR / (NEAR - FAR)
    return np.array([[scale, 0, 0, 0], [0, scale, 0, 0], [0, 0, *depth], [0, 0, -1, 0]]) @ view
