"""The equations of motion of links, as SymPy derives them from the Lagrangian: slow and obvious."""

from functools import cache

import numpy as np

_PER_LINK = (
    "masses", "lengths", "centres", "inertias", "damping", "drag", "quadratic_drag", "friction",
    "friction_speed", "armature", "gear",
)  # fmt: skip


@cache
def _derive(n, modules):
    """Return a function for M and f of M q'' = f, q = (x, y, theta): the pivot is free to move."""
    import sympy as sp

    q, u = sp.symbols(f"q:{n + 2}"), sp.symbols(f"u:{n + 2}")
    m, l, c, inertia, damping, drag, square, friction, slow, armature, back, torque = (
        sp.symbols(f"{name}:{n}") for name in "mlcidkvfsabt"
    )
    cart, push, g = sp.symbols("M F g")
    speeds = sp.Matrix(u)
    kinetic, potential, force = cart * (u[0] ** 2 + u[1] ** 2) / 2, 0, sp.zeros(n + 2, 1)
    force[0] = push
    joint = sp.Matrix(q[:2])
    for i in range(n):
        along, above = sp.Matrix([sp.sin(q[i + 2]), -sp.cos(q[i + 2])]), u[i + 1] if i else 0
        centre = joint + c[i] * along
        joint = joint + l[i] * along  # the tip
        moving, tip = centre.jacobian(q) * speeds, joint.jacobian(q) * speeds
        kinetic += m[i] * moving.dot(moving) / 2 + inertia[i] * u[i + 2] ** 2 / 2
        kinetic += armature[i] * ((back[i] - 1) * above + u[i + 2]) ** 2 / 2  # back = 1/gear
        potential += m[i] * g * centre[1]
        force -= joint.jacobian(q).T * (drag[i] + square[i] * sp.sqrt(tip.dot(tip))) * tip
        relative = u[i + 2] - above
        u_scaled = relative / slow[i]
        held = torque[i] - damping[i] * relative
        held -= friction[i] * u_scaled / sp.sqrt(1 + u_scaled**2)
        force[i + 2] += held
        if i > 0:
            force[i + 1] -= held
    lagrange = sp.Matrix([kinetic - potential])
    momenta = lagrange.jacobian(u)
    force += lagrange.jacobian(q).T - momenta.jacobian(q) * speeds
    own = (m, l, c, inertia, damping, drag, square, friction, slow, armature, back)
    symbols = (q, u, own, torque, cart, push, g)
    return sp.lambdify(symbols, (momenta.jacobian(u), force), modules=modules, cse=True)


def system(chain, theta, omega, torque, cart=1.0, push=0.0, velocity=(0.0, 0.0), *, exact=False):
    """Return M and f of a chain on a pivot that may move, of 50 digits where `exact`."""
    rows = [getattr(chain, name) for name in _PER_LINK]
    rows[-1] = 1.0 / rows[-1]
    values = ([0.0, 0.0, *theta], [*velocity, *omega], rows, torque, cart, push, chain.gravity)
    if exact:
        import mpmath

        mpmath.mp.dps = 50
        plain = [np.asarray(value, float).tolist() for value in values]
        return _derive(chain.n, "mpmath")(*_map(mpmath.mpf, plain))
    matrix, force = _derive(chain.n, "numpy")(*values)
    return matrix, force[:, 0]


def accelerations(chain, theta, omega, torque):
    """Return the angular accelerations with the pivot at rest, to the last digit of float64."""
    import mpmath

    matrix, force = system(chain, theta, omega, torque, exact=True)
    return np.array([*map(float, mpmath.lu_solve(matrix[2:, 2:], force[2:, :]))])


def _map(function, values):
    return [_map(function, one) if isinstance(one, list) else function(one) for one in values]
