"""Coverage rules: three exact tests of whether a polygon covers a sample, in 24.8 fixed point, with equal results.

Vertices and samples are int64 multiples of 1/256 pixel, y down. Coordinates stay below 2²⁸ (2²⁰ pixels, see view_geometry.GUARD), so
products of two differences stay below 2⁶⁰. Top-left rule: an edge owns the samples on it if the inside is to its right (left edge) or,
for a horizontal edge, below it (top edge). Each sample on an inner edge then belongs to exactly one triangle.

edges      one half-plane test an edge (Pineda, A Parallel Algorithm for Polygon Rasterization, 1988), without division.
areas      the signed areas of the triangles of the sample and two corners: inside if all have one sign.
scanline   sorted crossings of a horizontal line with all edges: inside after an odd number. Edges are half open in y, so that a corner
           is crossed once and a horizontal edge never. Supports concave polygons and holes.
"""

from __future__ import annotations

from ..jit.kernel import helper

ONE = 256  # fixed-point units a pixel
HALF = 128
EDGES, AREAS, SCANLINE = 0, 1, 2
NAMES = {"edges": EDGES, "areas": AREAS, "scanline": SCANLINE}


@helper
def doubled_area(ax: int, ay: int, bx: int, by: int, cx: int, cy: int) -> int:
    """Twice the signed area of a triangle; positive if a, b, c are clockwise on the screen (y down)."""
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


@helper
def owns(dx: int, dy: int) -> bool:
    """Whether an edge (dx, dy) of a clockwise polygon owns the samples on it: a top or left edge."""
    return dy < 0 or (dy == 0 and dx > 0)


@helper
def inside_edges(ax: int, ay: int, bx: int, by: int, cx: int, cy: int, px: int, py: int) -> bool:
    """Whether a clockwise triangle covers sample (px, py), by half-planes of its edges."""
    ab = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
    bc = (cx - bx) * (py - by) - (cy - by) * (px - bx)
    ca = (ax - cx) * (py - cy) - (ay - cy) * (px - cx)
    if ab < 0 or bc < 0 or ca < 0:
        return False
    on_ab = ab > 0 or owns(bx - ax, by - ay)
    on_bc = bc > 0 or owns(cx - bx, cy - by)
    return on_ab and on_bc and (ca > 0 or owns(ax - cx, ay - cy))


@helper
def inside_areas(ax: int, ay: int, bx: int, by: int, cx: int, cy: int, px: int, py: int) -> bool:
    """Whether a clockwise triangle covers sample (px, py), by signs of areas."""
    a = doubled_area(px, py, bx, by, cx, cy)
    b = doubled_area(ax, ay, px, py, cx, cy)
    c = doubled_area(ax, ay, bx, by, px, py)
    if min(a, min(b, c)) < 0:
        return False
    return (a > 0 or owns(cx - bx, cy - by)) and (b > 0 or owns(ax - cx, ay - cy)) and (c > 0 or owns(bx - ax, by - ay))


@helper
def crossings(loop_x, loop_y, first: int, count: int, y: int, out, crossing_count: int) -> int:
    """Insert the x of each crossing of line y with a closed loop into the sorted list out[:found]; returns its new length.

    Each x is rounded up to the next fixed-point unit: a sample px lies on the crossing or right of it iff px >= x.
    """
    for start in range(first, first + count):
        end = start + 1 if start + 1 < first + count else first
        y0, y1 = loop_y[start], loop_y[end]
        if (y0 <= y) == (y1 <= y):  # half open: an edge includes its upper end only
            continue
        x0, x1 = loop_x[start], loop_x[end]
        x = x0 - ((y - y0) * (x0 - x1)) // (y1 - y0)  # -(-a // b) is a / b rounded up
        place = crossing_count
        while place > 0 and out[place - 1] > x:  # insertion sort: the lists are short
            out[place] = out[place - 1]
            place -= 1
        out[place] = x
        crossing_count += 1
    return crossing_count


@helper
def inside_crossings(sorted_x, crossing_count: int, px: int) -> bool:
    """Whether a sample is inside by the even-odd rule: an odd number of crossings at it or left of it."""
    passed = 0
    while passed < crossing_count and sorted_x[passed] <= px:
        passed += 1
    return passed % 2 == 1
