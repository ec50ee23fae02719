"""Areas that two boxes have in common, and areas of their convex hulls.

They are those of ``geometry.py``: edges clipped by the other rectangle and Green's
theorem for the intersection, Cauchy's formula for the hull. The scalar code needs no
arrays.
"""

from .compile import part

# as in geometry.py: shrinks a box whose edges may lie on those of the other
_SHRINK_SHARE = 1e-8
MIN_DIVISOR = 1e-300  # as in geometry.py
# sine or cosine below which edges count as parallel
_PARALLEL = 1e-3


@part
def _share(
    x: float, y: float, end_x: float, end_y: float, half_l: float, half_w: float
) -> float:
    """Return the share of an edge inside the rectangle around 0.

    The edge goes from x, y to end_x, end_y.
    """
    dx = end_x - x
    dy = end_y - y
    # parallel: inside for all of its length or for none of it
    if abs(dx) < MIN_DIVISOR:
        dx = MIN_DIVISOR
    if abs(dy) < MIN_DIVISOR:
        dy = MIN_DIVISOR
    inverse_x = 1.0 / dx
    inverse_y = 1.0 / dy
    enter_x = (-half_l - x) * inverse_x
    leave_x = (half_l - x) * inverse_x
    enter_y = (-half_w - y) * inverse_y
    leave_y = (half_w - y) * inverse_y
    lower = max(min(enter_x, leave_x), min(enter_y, leave_y))
    upper = min(max(enter_x, leave_x), max(enter_y, leave_y))
    lower = max(0.0, lower)
    upper = min(1.0, upper)
    return max(upper - lower, 0.0)


@part
def _corners(
    x: float, y: float, cos: float, sin: float, l: float, w: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """Return the corners x y of a box.

    They come counterclockwise, the left front one first.
    """
    c_l = cos * (l * 0.5)
    s_l = sin * (l * 0.5)
    c_w = cos * (w * 0.5)
    s_w = sin * (w * 0.5)
    return (
        x + c_l - s_w,
        y + s_l + c_w,
        x - c_l - s_w,
        y - s_l + c_w,
        x - c_l + s_w,
        y - s_l - c_w,
        x + c_l + s_w,
        y + s_l - c_w,
    )


@part
def _edge_shares(
    x: float,
    y: float,
    cos: float,
    sin: float,
    l: float,
    w: float,
    half_l: float,
    half_w: float,
) -> tuple[float, float, float, float]:
    """Return the shares of edges inside the rectangle around 0.

    The box is at x, y. Its edges are the left, rear, right and front one.
    """
    x0, y0, x1, y1, x2, y2, x3, y3 = _corners(x, y, cos, sin, l, w)
    return (
        _share(x0, y0, x1, y1, half_l, half_w),
        _share(x1, y1, x2, y2, half_l, half_w),
        _share(x2, y2, x3, y3, half_l, half_w),
        _share(x3, y3, x0, y0, half_l, half_w),
    )


@part
def intersection_area(
    x: float,
    y: float,
    cos: float,
    sin: float,
    l_a: float,
    w_a: float,
    l_b: float,
    w_b: float,
) -> float:
    """Return the area common to two boxes.

    See `geometry.bev_intersection_area`. Box a is around 0 along the x axis, box b at
    x, y.
    """
    l_in = l_a
    w_in = w_a
    if min(abs(cos), abs(sin)) < _PARALLEL:
        side_a = min(l_a, w_a)
        side_b = min(l_b, w_b)
        margin = _SHRINK_SHARE * min(side_a, side_b)
        l_in = max(l_a - margin, 0.0)
        w_in = max(w_a - margin, 0.0)
    # Twice the triangle over an edge with the centre of a: half an area of b, and what
    # the shift of b adds to it.
    l_share, rear, r_share, front = _edge_shares(
        x, y, cos, sin, l_b, w_b, l_in * 0.5, w_in * 0.5
    )
    along = cos * x + sin * y
    across = cos * y - sin * x
    area = (l_share + r_share + rear + front) * (l_b * w_b * 0.5)
    area += (l_share - r_share) * (l_b * across) + (front - rear) * (w_b * along)
    l_share, rear, r_share, front = _edge_shares(
        -along, -across, cos, -sin, l_in, w_in, l_b * 0.5, w_b * 0.5
    )
    area = area * 0.5 + (l_share + rear + r_share + front) * (l_a * w_a * 0.25)
    smaller_area = min(l_a * w_a, l_b * w_b)
    return max(0.0, min(area, smaller_area))


@part
def _moment(x: float, y: float, u_x: float, u_y: float) -> float:
    return (x * u_x + y * u_y) * (y * u_x - x * u_y)


@part
def _sector(
    a_x: float,
    a_y: float,
    b_x: float,
    b_y: float,
    u_x: float,
    u_y: float,
    v_x: float,
    v_y: float,
) -> float:
    """Return twice the hull's area between directions u and v.

    See geometry.py. The farthest corners of the boxes are a and b: p is farther at u, q
    the other one.
    """
    d_x = a_x - b_x
    d_y = a_y - b_y
    a_farther_at_u = d_x * u_x + d_y * u_y >= 0.0
    a_farther_at_v = d_x * v_x + d_y * v_y >= 0.0
    if a_farther_at_u:
        p_x = a_x
        p_y = a_y
        q_x = b_x
        q_y = b_y
    else:
        p_x = b_x
        p_y = b_y
        q_x = a_x
        q_y = a_y
    area = _moment(p_x, p_y, u_x, u_y)
    if a_farther_at_u == a_farther_at_v:
        return area - _moment(p_x, p_y, v_x, v_y)
    change = _moment(q_x, q_y, -d_y, d_x) - _moment(p_x, p_y, -d_y, d_x)
    d_squared = max(d_x * d_x + d_y * d_y, MIN_DIVISOR)
    return area - _moment(q_x, q_y, v_x, v_y) + change / d_squared


@part
def hull_area(
    x: float,
    y: float,
    cos: float,
    sin: float,
    l_a: float,
    w_a: float,
    l_b: float,
    w_b: float,
) -> float:
    """Return the area of the convex hull of two boxes.

    Box a is around 0 along the x axis, box b at x, y. Cauchy's formula
    ``1/2 int (h^2 - h'^2)`` over all directions, with h the farther of both boxes in a
    direction.
    """
    # A box turned by 90 degrees is a box with length and width exchanged: what is left
    # is a turn within [0, 90].
    abs_cos = abs(cos)
    abs_sin = abs(sin)
    if (cos > 0.0) != (sin >= 0.0):
        cos = abs_sin
        sin = abs_cos
        length_b = l_b
        l_b = w_b
        w_b = length_b
    else:
        cos = abs_cos
        sin = abs_sin
    l = l_a * 0.5
    w = w_a * 0.5
    x0, y0, x1, y1, x2, y2, x3, y3 = _corners(x, y, cos, sin, l_b, w_b)
    area = _sector(l, w, x3, y3, 1.0, 0.0, cos, sin) + _sector(
        l, w, x0, y0, cos, sin, 0.0, 1.0
    )
    area += _sector(-l, w, x0, y0, 0.0, 1.0, -sin, cos) + _sector(
        -l, w, x1, y1, -sin, cos, -1.0, 0.0
    )
    area += _sector(-l, -w, x1, y1, -1.0, 0.0, -cos, -sin) + _sector(
        -l, -w, x2, y2, -cos, -sin, 0.0, -1.0
    )
    area += _sector(l, -w, x2, y2, 0.0, -1.0, sin, -cos) + _sector(
        l, -w, x3, y3, sin, -cos, 1.0, 0.0
    )
    return area * 0.5


@part
def are_apart(
    x: float,
    y: float,
    cos: float,
    sin: float,
    l_a: float,
    w_a: float,
    l_b: float,
    w_b: float,
) -> bool:
    """Return whether an axis of either box separates them.

    Arguments are those of `intersection_area`.
    """
    abs_cos = abs(cos)
    abs_sin = abs(sin)
    if (
        2.0 * abs(x) > l_a + l_b * abs_cos + w_b * abs_sin
        or 2.0 * abs(y) > w_a + l_b * abs_sin + w_b * abs_cos
    ):
        return True
    along = abs(cos * x + sin * y)
    across = abs(cos * y - sin * x)
    return (
        2.0 * along > l_b + l_a * abs_cos + w_a * abs_sin
        or 2.0 * across > w_b + l_a * abs_sin + w_a * abs_cos
    )
